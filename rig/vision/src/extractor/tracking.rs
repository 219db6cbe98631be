//! The mechanism's outline through the images of a film: from each image's silhouette where that tells, else from where it was.

use rayon::prelude::*;

use super::{Extractor, Oriented};
use crate::background::Contrast;
use crate::config::Mode;
use crate::figure::Figure;
use crate::figure::arm::{self, Arm};
use crate::figure::canvas::Canvas;
use crate::figure::chain::Chain;
use crate::figure::edges::View;
use crate::figure::film::{Evidence, Film, START_REACH_PX};
use crate::figure::fit::Fitted;
use crate::keypoints::{Found, hidden_base};
use crate::outline::Outline;
use crate::rejection::Rejection;
use crate::spline::{arc_lengths, distance};
use camera::calibration::Px;
use camera::source::TimedImage;

/// Where the mechanism was last.
#[derive(Debug, Default)]
pub(super) struct Track {
    /// Time \[s\] and pose, the latest last.
    seen: Vec<(f64, Vec<f64>)>,
}

/// The way of an image's pose from the ones before may be off by this much for each image since \[px\].
const STRAY_PX: f64 = 8.0;
/// After this many images without it, it may be anywhere.
const LONGEST_GAP: f64 = 6.0;
/// A figure that explains a smaller share of a sample is another mechanism's.
const LEAST_EXPLAINED: f64 = 0.3;
/// Corner radii of ends that are told apart, as shares of the half width: square, rounded and round.
const ROUNDINGS: [f64; 3] = [0.0, 0.5, 1.0];
/// How well half widths and an arm's length are known from silhouettes, 1 sigma as a share.
const WIDTH_STD: f64 = 0.3;
const LENGTH_STD: f64 = 0.1;
/// Where the search for an overhang begins, in half widths: what a pivot's screw wants of material; and its sigma.
const FIRST_OVERHANG: f64 = 0.5;
const OVERHANG_STD: f64 = 1.0;

/// An image in which the keypoints are found.
pub(super) struct Placed {
    pub(super) found: Found,
    /// The middle line, base first \[px\].
    pub(super) line: Vec<Px>,
    pub(super) doubt: Option<String>,
}

/// A keypoint of a larger sigma is doubtful \[px\].
const CERTAIN_PX: f64 = 1.0;

impl Placed {
    /// Where a film's figure lies.
    pub(super) fn by_outline(film: &Film, fitted: &Fitted) -> Self {
        let (points, sigmas, line) = film.keypoints(fitted);
        let worst = sigmas.iter().map(|sigma| sigma.whole_px).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        let doubt = worst.filter(|(_, std)| *std > CERTAIN_PX).map(|(i, std)| {
            format!("P{i} is known to {std:.1} px (1 sigma) only: too little of the mechanism is seen there")
        });
        Self { found: Found { points, sigmas }, line, doubt }
    }
}

/// A film as learned, and how well it explains its sample.
pub(super) struct Learnt {
    pub(super) film: Film,
    pub(super) evidence: Evidence,
    pub(super) rounding: f64,
}

impl Extractor {
    /// Learns the film from the images of a sample: `contrasts`, and the middle lines of those whose silhouette tells.
    pub(super) fn learn_film(
        &self,
        contrasts: &[Option<Contrast>],
        oriented: &[Result<Oriented, Rejection>],
    ) -> Option<Learnt> {
        let base = self.base?;
        let lines: Vec<&Oriented> = oriented.iter().flatten().collect();
        if lines.is_empty() || self.outline.mode == Mode::Paper {
            return None;
        }
        let canvas = Canvas::new(&self.plane, base);
        let known = self.outline.end_rounding.filter(|_| self.outline.mode == Mode::Links);
        let tried =
            known.map_or(ROUNDINGS.to_vec(), |rounding| vec![rounding]).into_iter().filter_map(|rounding| {
                let (figure, shared) = match self.outline.mode {
                    Mode::Links => chain_of(
                        &self.outline,
                        &canvas,
                        base,
                        self.config.base_std_px.get(),
                        &lines,
                        rounding,
                    ),
                    _ => self.arm_of(&canvas, base, &lines, rounding),
                };
                let (views, starts): (Vec<View>, Vec<Option<Vec<f64>>>) = contrasts
                    .iter()
                    .zip(oriented)
                    .filter_map(|(contrast, oriented)| {
                        let start = oriented.as_ref().ok().map(|oriented| {
                            let means: Vec<f64> = shared.iter().map(|(mean, _)| *mean).collect();
                            let line: Vec<Px> =
                                oriented.candidate.line.points.iter().map(|px| canvas.at_px(*px)).collect();
                            figure.start(&means, &line)
                        });
                        Some((self.view(contrast.as_ref()?), start))
                    })
                    .unzip();
                let (film, evidence) = Film::learn(figure, &canvas, &views, &starts, &shared)?;
                Some(Learnt { film, evidence, rounding })
            });
        tried
            .min_by(|a, b| a.evidence.misfit.total_cmp(&b.evidence.misfit))
            .filter(|learnt| learnt.evidence.explained >= LEAST_EXPLAINED)
    }

    fn arm_of(
        &self,
        canvas: &Canvas,
        base: Px,
        lines: &[&Oriented],
        rounding: f64,
    ) -> (Box<dyn Figure>, Vec<(f64, f64)>) {
        let on = |oriented: &Oriented| -> Vec<Px> {
            oriented.candidate.line.points.iter().map(|px| canvas.at_px(*px)).collect()
        };
        let start = canvas.at_px(base);
        let hidden = |oriented: &&&Oriented| hidden_base(0.0, &self.shape(oriented)).is_some();
        let root_seen = 2 * lines.iter().filter(hidden).count() < lines.len();
        let mut lengths: Vec<f64> = lines
            .iter()
            .map(|oriented| {
                let line = on(oriented);
                let seen = arc_lengths(&line).last().copied().unwrap_or(0.0);
                seen + if root_seen { 0.0 } else { distance(start, line[0]) }
            })
            .collect();
        let length = ground::statistics::median(&mut lengths, f64::total_cmp).unwrap_or(1.0);
        // Counted from the tip, where nothing is hidden; none where something cuts the silhouette, within a width of it.
        let width = |k: usize| -> Option<f64> {
            let back = ((1.0 - k as f64 / (arm::WIDTHS - 1) as f64) * length).round() as usize;
            let of = |oriented: &&Oriented| {
                let half = &oriented.candidate.line.half_width;
                let cut = if root_seen { 0.0 } else { 2.0 * oriented.candidate.line.mean_half_width() };
                let at = half.len().checked_sub(1 + back).or(root_seen.then_some(0))?;
                (at as f64 >= cut).then_some(half[at])
            };
            let mut all: Vec<f64> = lines.iter().filter_map(of).collect();
            ground::statistics::median(&mut all, f64::total_cmp)
        };
        let mut widths: Vec<Option<f64>> = (0..arm::WIDTHS).map(width).collect();
        // What is hidden goes on as what is next to it does.
        for k in (0..arm::WIDTHS).rev() {
            let next = |by: usize| widths.get(k + by).copied().flatten();
            widths[k] = widths[k].or_else(|| Some(2.0 * next(1)? - next(2)?)).or(next(1));
        }
        let widths = widths.into_iter().map(|half| half.unwrap_or(1.0).max(1.0));
        let std = self.config.base_std_px.get();
        let mut shared = vec![(start[0], std), (start[1], std), (length, LENGTH_STD * length)];
        shared.extend(widths.map(|half| (half, WIDTH_STD * half)));
        (Box::new(Arm::new(self.outline.shares.clone(), length, rounding, root_seen)), shared)
    }

    pub(super) fn view<'a>(&'a self, contrast: &'a Contrast) -> View<'a> {
        View { contrast, hidden: self.hidden.as_ref() }
    }

    /// The figure in each image: from its own silhouette, else from the images before.
    pub(super) fn tracked(
        &mut self,
        film: &Film,
        images: &[TimedImage],
        contrasts: &[Option<Contrast>],
        oriented: &[Result<Oriented, Rejection>],
    ) -> Vec<Result<Fitted, Rejection>> {
        let jobs: Vec<(&Option<Contrast>, &Result<Oriented, Rejection>)> =
            contrasts.iter().zip(oriented).collect();
        let own: Vec<Result<Fitted, Rejection>> = jobs
            .into_par_iter()
            .map(|(contrast, oriented)| match (contrast, oriented) {
                (Some(contrast), Ok(oriented)) => film.fit(
                    &self.view(contrast),
                    film.start(&oriented.candidate.line.points),
                    START_REACH_PX,
                ),
                (_, Err(why)) => Err(why.clone()),
                (None, Ok(_)) => unreachable!("a silhouette is seen in a contrast"),
            })
            .collect();
        let mut track = std::mem::take(&mut self.last.track);
        let found = own.into_iter().zip(images).zip(contrasts).map(|((own, image), contrast)| {
            let found = own.or_else(|why| {
                let contrast = contrast.as_ref().ok_or_else(|| why.clone())?;
                let (start, reach) = track.expected(film, image.time_s).ok_or(why)?;
                film.fit(&self.view(contrast), start, reach)
            });
            if let Ok(found) = &found {
                track.take(image.time_s, &found.pose);
            }
            found
        });
        let found = found.collect();
        self.last.track = track;
        found
    }
}

impl Track {
    fn take(&mut self, time_s: f64, pose: &[f64]) {
        if self.seen.len() == 2 {
            self.seen.remove(0);
        }
        self.seen.push((time_s, pose.to_vec()));
    }

    /// The pose at `time_s` if it goes on as it did, and how far it may stray \[px\].
    fn expected(&self, film: &Film, time_s: f64) -> Option<(Vec<f64>, f64)> {
        let [(before_s, before), (latest_s, latest)] = &self.seen[..] else { return None };
        let share = (time_s - latest_s) / (latest_s - before_s).max(f64::MIN_POSITIVE);
        let stray = STRAY_PX * share.max(1.0);
        (share > 0.0 && share <= LONGEST_GAP).then(|| (film.ahead(before, latest, share), stray))
    }
}

fn chain_of(
    outline: &Outline,
    canvas: &Canvas,
    base: Px,
    base_std: f64,
    lines: &[&Oriented],
    rounding: f64,
) -> (Box<dyn Figure>, Vec<(f64, f64)>) {
    let median = |mut all: Vec<f64>| ground::statistics::median(&mut all, f64::total_cmp).unwrap_or(1.0);
    let half = median(lines.iter().map(|one| one.candidate.line.mean_half_width()).collect());
    let seen = median(lines.iter().map(|one| one.candidate.line.length_px).collect());
    let scale = canvas.scale_m();
    let (lengths, unit): (Vec<f64>, (f64, f64)) = match &outline.lengths_m {
        Some(lengths) => (lengths.iter().map(|length| length / scale).collect(), (1.0, 0.0)),
        None => (vec![1.0; outline.links], (seen / outline.links as f64, f64::INFINITY)),
    };
    let overhang = match outline.overhang_m {
        Some((overhang, std)) => (overhang / scale, std / scale),
        None => (FIRST_OVERHANG * half, OVERHANG_STD * half),
    };
    let start = canvas.at_px(base);
    let mut shared = vec![(start[0], base_std), (start[1], base_std), unit, overhang];
    shared.extend((0..lengths.len()).map(|_| (half, WIDTH_STD * half)));
    let chain = Chain { lengths, tip_overhang: outline.tip_overhang_m / scale, rounding };
    (Box::new(chain), shared)
}
