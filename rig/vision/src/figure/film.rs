//! What all images of a film share: where the mechanism is held, how long and how wide it is.

use ground::statistics::{MEDIAN_TO_SIGMA, median};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::canvas::Canvas;
use super::edges::View;
use super::fit::{Fitted, edge_slopes, fit};
use super::{Figure, Prior};
use crate::keypoints::Sigma;
use crate::rejection::Rejection;
use crate::spline::distance;
use camera::calibration::Px;

/// A figure whose shared numbers are known.
#[derive(Debug)]
pub(crate) struct Film {
    figure: Box<dyn Figure>,
    canvas: Canvas,
    prior: Prior,
    /// The shared numbers and their sigmas.
    shared: Vec<(f64, f64)>,
    /// The sample's images agree on them: a further one says nothing new.
    agreed: bool,
}

/// How well a film's images are explained.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Evidence {
    /// Share of the sample's images that the figure explains.
    pub(crate) explained: f64,
    /// Tukey's mean over their outlines, from 0 to 1, lower is better; 1 for an image that is not explained.
    pub(crate) misfit: f64,
}

/// How loosely the shared numbers are held after each round of fitting all images and taking together what they say \[px\]: less and
/// less, at last as they say themselves.
const LOOSE_PX: [Option<f64>; 5] = [Some(1.0), Some(0.3), Some(0.1), None, None];
/// Rounds of taking images together that leave those aside which are off.
const ROUNDS: usize = 3;
/// A beginning may be off by this much \[px\].
pub(crate) const START_REACH_PX: f64 = 8.0;
/// Least share of the outline that must be open to be seen, and of that, where edges must be: on the whole, and on each part
/// of which at least `JUDGED_PLACES` are open.
const LEAST_OPEN: f64 = 0.35;
const LEAST_FOUND: f64 = 0.75;
const LEAST_FOUND_PART: f64 = 0.5;
const JUDGED_PLACES: usize = 12;
/// What differs between images by more than this many of its sigmas is not the same in all.
const SAME_SIGMAS: f64 = 1.5;
/// What one pose may mislead by however often it is seen, 1 sigma \[px\]: how its edges lie on the pixels; measured on the mock's
/// pictures. Poses in which a keypoint lies this far from where it did are others \[px\], and fewer of them leave it to each image.
const POSE_STD_PX: f64 = 0.1;
const OTHER_POSE_PX: f64 = 2.0;
const LEAST_POSES: usize = 8;
/// What differs by more than this many sigmas of its mean is each image's own.
const OTHER_SIGMAS: f64 = 30.0;
/// What many images cannot better, 1 sigma \[px\]: how blurred an edge is, is not known.
const LEAST_STD_PX: f64 = 0.02;
/// An image that is off by so many sigmas counts half.
const OFF_SIGMAS: f64 = 3.0;

/// What some images say together.
struct Agreed {
    /// The shared numbers, mean and sigma.
    shared: Vec<(f64, f64)>,
    /// By how much each differs between images, beyond what its sigmas say.
    excess: Vec<f64>,
}

impl Film {
    /// Learns from `views`, some images of a film, what they share: first guessed as `shared`, mean and sigma of each number.
    /// `starts` are the images' poses, roughly, where something tells.
    ///
    /// `None` where no image is explained.
    pub(crate) fn learn(
        figure: Box<dyn Figure>,
        canvas: &Canvas,
        views: &[View],
        starts: &[Option<Vec<f64>>],
        shared: &[(f64, f64)],
    ) -> Option<(Self, Evidence)> {
        let first = shared.to_vec();
        let mut film = Self::knowing(figure, canvas, first.clone());
        for loose_px in LOOSE_PX {
            let fits = film.all(views, starts);
            let known: Vec<&Fitted> = fits.iter().flatten().collect();
            if known.is_empty() {
                return None;
            }
            let Agreed { shared: together, excess } = film.together(&known, &first)?;
            let poses = film.poses(&known);
            let one_pose = POSE_STD_PX / (poses as f64).sqrt();
            let std = |(std, excess): (&f64, &f64)| match loose_px {
                Some(loose) => std.hypot(loose),
                None => std.hypot(*excess).hypot(one_pose),
            };
            let stds = together.iter().map(|(_, std)| std).zip(&excess).map(std).zip(&first);
            let stds: Vec<f64> = stds.map(|(std, (_, before))| std.min(*before)).collect();
            let shared = together.iter().zip(stds).map(|((mean, _), std)| (*mean, std)).collect();
            film = Self::knowing(film.figure, canvas, shared);
            film.agreed = loose_px.is_none()
                && poses >= LEAST_POSES
                && together.iter().zip(&excess).all(|((_, std), excess)| *excess < OTHER_SIGMAS * std);
        }
        let fits = film.all(views, starts);
        let misfits = fits.iter().map(|fit| fit.as_ref().map_or(1.0, |fit| fit.misfit));
        let evidence = Evidence {
            explained: fits.iter().flatten().count() as f64 / fits.len().max(1) as f64,
            misfit: misfits.sum::<f64>() / fits.len().max(1) as f64,
        };
        Some((film, evidence))
    }

    /// How many poses `fits` are of that differ.
    fn poses(&self, fits: &[&Fitted]) -> usize {
        let mut poses: Vec<Vec<Px>> = Vec::new();
        for fit in fits {
            let points = self.figure.points(&fit.pose).0;
            let same =
                |other: &Vec<Px>| points.iter().zip(other).all(|(a, b)| distance(*a, *b) < OTHER_POSE_PX);
            if !poses.iter().any(same) {
                poses.push(points);
            }
        }
        poses.len()
    }

    fn knowing(figure: Box<dyn Figure>, canvas: &Canvas, shared: Vec<(f64, f64)>) -> Self {
        let mut mean: Vec<f64> = shared.iter().map(|(mean, _)| *mean).collect();
        let std: Vec<f64> = shared.iter().map(|(_, std)| *std).collect();
        mean.resize(figure.size(), 0.0);
        let prior = Prior::new(mean, &std, figure.stiffness());
        Self { figure, canvas: canvas.clone(), prior, shared, agreed: false }
    }

    fn all(&self, views: &[View], starts: &[Option<Vec<f64>>]) -> Vec<Option<Fitted>> {
        let one =
            |(view, start): (&View, &Option<Vec<f64>>)| self.fit(view, start.clone()?, START_REACH_PX).ok();
        views.par_iter().zip(starts).map(one).collect()
    }

    /// The shared numbers that `fits` agree on, where `first` was known of them before.
    fn together(&self, fits: &[&Fitted], first: &[(f64, f64)]) -> Option<Agreed> {
        let count = self.figure.shared();
        let held = Prior::new(
            first.iter().map(|(mean, _)| *mean).collect(),
            &first.iter().map(|(_, std)| *std).collect::<Vec<f64>>(),
            DMatrix::zeros(count, count),
        );
        let told: Vec<(DMatrix<f64>, DVector<f64>)> = fits.iter().map(|fit| self.told(fit)).collect();
        let mut weights = vec![1.0; told.len()];
        let mut mean = DVector::from_column_slice(&held.mean);
        let mut covariance = DMatrix::zeros(count, count);
        for _ in 0..ROUNDS {
            let mut information = held.precision.clone();
            let mut right = &held.precision * DVector::from_column_slice(&held.mean);
            for ((own, moment), weight) in told.iter().zip(&weights) {
                information += own * *weight;
                right += moment * *weight;
            }
            covariance = information.cholesky()?.inverse();
            mean = &covariance * right;
            for ((own, moment), weight) in told.iter().zip(&mut weights) {
                let pull = moment - own * &mean;
                // How far this image alone would move what all agree on, in its own sigmas.
                let alone = (own + &held.precision).cholesky()?.inverse();
                let off = pull.dot(&(alone * &pull)) / count as f64;
                *weight = 1.0 / (1.0 + off / (OFF_SIGMAS * OFF_SIGMAS));
            }
        }
        let excess = |i: usize| {
            let known = told.iter().filter(|(own, _)| own[(i, i)] > 0.0);
            let (mut off, mut known): (Vec<f64>, Vec<f64>) = known
                .map(|(own, moment)| {
                    let pull = moment[i] - (own.row(i) * &mean)[0];
                    (pull.abs() / own[(i, i)].sqrt(), own[(i, i)])
                })
                .unzip();
            let sigmas = MEDIAN_TO_SIGMA * median(&mut off, f64::total_cmp).unwrap_or(0.0);
            let std = median(&mut known, f64::total_cmp).map_or(0.0, |known| known.sqrt().recip());
            if sigmas > SAME_SIGMAS { std * (sigmas * sigmas - 1.0).sqrt() } else { 0.0 }
        };
        let shared = (0..count).map(|i| (mean[i], covariance[(i, i)].sqrt().max(LEAST_STD_PX))).collect();
        Some(Agreed { shared, excess: (0..count).map(excess).collect() })
    }

    /// What the picture of `fit` says of the shared numbers, whatever its own are: information and that times their value.
    fn told(&self, fit: &Fitted) -> (DMatrix<f64>, DVector<f64>) {
        let (size, count) = (self.figure.size(), self.figure.shared());
        let own = size - count;
        let information = &fit.information + self.figure.stiffness();
        let shared = information.view((0, 0), (count, count)).into_owned();
        let cross = information.view((0, count), (count, own)).into_owned();
        let rest = information.view((count, count), (own, own)).into_owned();
        let ridge = 1e-9 * rest.diagonal().max();
        let marginal = match (rest + DMatrix::identity(own, own) * ridge).cholesky() {
            Some(rest) => shared - &cross * rest.solve(&cross.transpose()),
            None => DMatrix::zeros(count, count),
        };
        // The fit rests where the picture's pull and the prior's are even.
        let at = DVector::from_column_slice(&fit.pose[..count]);
        let held = self.prior.precision.view((0, 0), (count, count));
        let off = DVector::from_fn(count, |i, _| fit.pose[i] - self.prior.mean[i]);
        let moment = &marginal * at + held * off;
        (marginal, moment)
    }

    /// The pose whose middle lies about on `line` \[px\], base first.
    pub(crate) fn start(&self, line: &[Px]) -> Vec<f64> {
        let line: Vec<Px> = line.iter().map(|px| self.canvas.at_px(*px)).collect();
        self.figure.start(&self.prior.mean[..self.figure.shared()], &line)
    }

    /// The figure where `view` shows it, beginning at `start`.
    ///
    /// # Errors
    /// [`Rejection::NoOutline`].
    pub(crate) fn fit(&self, view: &View, start: Vec<f64>, reach: f64) -> Result<Fitted, Rejection> {
        let lost = Rejection::NoOutline { part: None, found: 0, open: 0 };
        let mut fitted =
            fit(self.figure.as_ref(), &self.canvas, view, &self.prior, start, reach).ok_or(lost)?;
        let whole = fitted.whole();
        let share = |a: usize, b: usize| a as f64 / b.max(1) as f64;
        if share(whole.open, whole.places) < LEAST_OPEN || share(whole.found, whole.open) < LEAST_FOUND {
            return Err(Rejection::NoOutline { part: None, found: whole.found, open: whole.open });
        }
        for (i, part) in fitted.support.iter().enumerate() {
            if part.open >= JUDGED_PLACES && share(part.found, part.open) < LEAST_FOUND_PART {
                return Err(Rejection::NoOutline { part: Some(i), found: part.found, open: part.open });
            }
        }
        if self.agreed
            && let Some(covariance) = self.covariance(&fitted)
        {
            fitted.covariance = covariance;
        }
        Ok(fitted)
    }

    /// Of a fit's numbers, where the shared ones are known from the sample and from this image's no better.
    fn covariance(&self, fitted: &Fitted) -> Option<DMatrix<f64>> {
        let count = self.figure.shared();
        let mut information = &fitted.information + &self.prior.precision;
        let mut shared = information.view_mut((0, 0), (count, count));
        shared -= self.told(fitted).0;
        Some(information.cholesky()?.inverse())
    }

    /// P0..Pn where a fit puts them \[px\], sigma of each per axis, and the middle line.
    pub(crate) fn keypoints(&self, fitted: &Fitted) -> (Vec<Px>, Vec<Sigma>, Vec<Px>) {
        let (points, sigmas) = fitted.keypoints(self.figure.as_ref(), &self.canvas);
        let line = self.figure.line(&fitted.pose).into_iter().map(|at| self.canvas.px(at)).collect();
        (points, sigmas, line)
    }

    /// The mechanism in `pose`: convex polygons that are it together, and P0..Pn \[px\].
    pub(crate) fn drawn(&self, pose: &[f64]) -> (Vec<Vec<Px>>, Vec<Px>) {
        let px = |places: Vec<Px>| places.into_iter().map(|at| self.canvas.px(at)).collect();
        let polygons = self.figure.polygons(pose).into_iter().map(px).collect();
        (polygons, px(self.figure.points(pose).0))
    }

    /// The slopes of the edges that `view` shows of the outline of `pose`, each as a share of its step \[1/px\].
    pub(crate) fn edge_slopes(&self, view: &View, pose: &[f64]) -> Vec<f64> {
        edge_slopes(self.figure.as_ref(), &self.canvas, view, pose)
    }

    /// A number that all images share, and its sigma \[px\].
    pub(crate) fn shared(&self, number: usize) -> (f64, f64) {
        self.shared[number]
    }

    /// Size of a pixel of its numbers \[m\].
    pub(crate) fn scale_m(&self) -> f64 {
        self.canvas.scale_m()
    }

    /// Where a pose goes from `before` to `latest` and on by `share` of the way between.
    pub(crate) fn ahead(&self, before: &[f64], latest: &[f64], share: f64) -> Vec<f64> {
        before.iter().zip(latest).map(|(before, latest)| latest + share * (latest - before)).collect()
    }
}
