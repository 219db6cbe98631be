//! What all images of a film share, learned from a sample of them: tank, colours and rims, P0, widths and depths.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use camera::calibration::{Plane, Px};
use camera::source::TimedImage;

use super::{GOOD, LEAST_AGREEMENT, PoseFilm, ROUGH, WIDE_PX, cheapest, is_sound};
use crate::continuity::Continuity;
use crate::mask::Mask;
use crate::pose::colours::{Colour, medians, smoothed};
use crate::pose::edge::{Edges, USUAL_BLUR_PX};
use crate::pose::mechanism::Mechanism;
use crate::pose::rims::{DIRECTIONS, NO_RIM, Profile, lit_from};
use crate::pose::search::{Candidate, Looks, Search};
use crate::pose::shared::{BEYOND, DEPTH, Shared, WIDTH};
use crate::pose::sigma::Residuals;
use crate::pose::solve::{Explained, Scene, prior};
use crate::pose::tank::{Light, PLANES, Planes, Reduced, Tank, painted};
use crate::pose::view::Camera;
use crate::rejection::Rejection;

/// How well P0 is known from where it was clicked, 1 sigma \[m\]; chosen.
const BASE_STD_M: f64 = 0.0012;
/// Width over the model's, 1 sigma: of a soft body, whose section is rarely its model's, and of a link. Chosen.
const SOFT_WIDTH_STD: f64 = 0.35;
const LINK_WIDTH_STD: f64 = 0.05;
/// A soft body is rather thicker than its model's section; where the search begins, and what is tried then.
const SOFT_WIDTH: f64 = 1.3;
const TRIED_WIDTHS: [f64; 5] = [0.8, 1.0, 1.2, 1.45, 1.75];
/// Blurs of edges that are told apart \[px\]; chosen.
const BLURS_PX: [f64; 12] = [0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4, 1.6, 1.9, 2.3];
/// Corner radii of links' ends that are told apart, as shares of the half width: square, rounded and round.
const ROUNDINGS: [f64; 3] = [0.0, 0.5, 1.0];
/// Depth over the model's, 1 sigma; where nobody says how far the camera is, that is unknown too.
const DEPTH_STD: f64 = 0.5;
const FAR_DEPTH_STD: f64 = 0.8;
/// The distance that is assumed where nobody says \[m\].
const USUAL_DISTANCE_M: f64 = 0.5;
/// Depth is told by how lit its sides look: never better than this.
const LEAST_DEPTH_STD: f64 = 0.35;
/// A section within this share of its model's is the model's.
const SAME_SECTION: f64 = 0.15;
/// Images repeat each other's faults: each of the sample counts as this share of an independent one.
const IMAGE_WEIGHT: f64 = 0.25;
/// Largest steps of what is shared from round to round: P0 and links in front \[m\], widths, depths.
const MOST_STEP_M: f64 = 0.0015;
const MOST_STEP_WIDTH: f64 = 0.2;
const MOST_STEP_DEPTH: f64 = 0.3;
/// How far a link may be in front of the plane, 1 sigma \[m\], where its half depth is less; chosen.
const LEAST_FRONT_STD_M: f64 = 0.002;
/// Depth factors where the outline faces the camera's foot: whether the flank is seen there is not known. Chosen.
const FACING_DEPTH: f64 = 0.5;
const FACING_DEPTH_STD: f64 = 1.0;
/// How much of the light's asymmetry at the rims is a shift of the edges towards it, and one sigma of that; measured on rendered films.
const LIT_SHIFT: f64 = 0.8;
const LIT_STD: f64 = 0.5;
/// How far from the model's tip a round end may be seen, as a share of its half width, 1 sigma: its side away from the light is as dark as a dark
/// tank. Chosen; edges by the other sides tell how far it is.
const END_STD: f64 = 0.15;
/// How far beyond a chain's outline its edges are seen, 1 sigma \[px\]: what is taken of lens and camera is about right only. Chosen.
const BEYOND_STD_PX: f64 = 0.4;
/// Points of the outline are so far apart \[px\] in narrow pictures and in wide ones.
const SPACING_PX: [f64; 2] = [4.0, 8.0];

/// A picture of the sample.
struct Sampled {
    planes: Planes,
    reduced: Reduced,
}

/// What a film's config says of where it was filmed.
#[derive(Debug, Clone, Copy)]
pub struct Given<'a> {
    /// Where P0 is, about \[px\].
    pub base: Px,
    /// Air + glass / 1.52 + water / 1.333 between camera and plane \[m\].
    pub distance_m: Option<f64>,
    /// Radius of the corners of links' ends as a share of the half width; none: as the film tells.
    pub end_rounding: Option<f64>,
    /// What stands before the mechanism.
    pub blocked: Option<&'a Mask>,
    /// The tank without the mechanism.
    pub empty: Option<&'a TimedImage>,
}

/// What is given of the tank.
#[derive(Clone, Copy)]
struct GivenTank<'a> {
    blocked: Option<&'a Mask>,
    empty: Option<&'a Planes>,
}

impl GivenTank<'_> {
    /// `learned`, with what is given.
    fn completed(&self, mut learned: Tank) -> Tank {
        if let Some(empty) = self.empty {
            learned.fill(empty);
        }
        if let Some(blocked) = self.blocked {
            learned.block(|column, row| blocked.at(column as isize, row as isize));
        }
        learned
    }
}

impl PoseFilm {
    /// Learns from `sample` what its images share.
    ///
    /// # Errors
    /// [`Rejection`], where no image of the sample can be read or shows the mechanism.
    pub fn learn(
        sample: &[TimedImage],
        mechanism: Mechanism,
        plane: &Plane,
        given: Given<'_>,
    ) -> Result<Self, Rejection> {
        let Given { base, distance_m, end_rounding, blocked, empty } = given;
        let pictures: Vec<Planes> = sample.par_iter().filter_map(Planes::of).collect();
        let nothing = || Rejection::Unreadable("no image of the sample can be read".into());
        let first = pictures.first().ok_or_else(nothing)?;
        let size = [first.width, first.height];
        let by = if size[0] > WIDE_PX { 6 } else { 4 };
        let sample: Vec<Sampled> = pictures
            .into_par_iter()
            .filter(|planes| [planes.width, planes.height] == size)
            .map(|planes| Sampled { reduced: planes.reduced(by), planes })
            .collect();
        let middle = size.map(|side| side as f64 / 2.0);
        let spacing_px = SPACING_PX[usize::from(size[0] > WIDE_PX)];
        let mechanism = mechanism.laid_out(spacing_px * plane.metres_per_pixel(middle));
        let soft = mechanism.is_soft();
        let width = if soft { SOFT_WIDTH } else { 1.0 };
        let camera = Camera::new(plane, size, Some(distance_m.unwrap_or(USUAL_DISTANCE_M)));
        let in_front_m = if soft { Vec::new() } else { vec![0.0; mechanism.links()] };
        let shared = Shared {
            base: plane.metres(base),
            width: [width; 2],
            depth: [1.0, FACING_DEPTH],
            beyond_m: 0.0,
            in_front_m,
        };
        let width_std = if soft { SOFT_WIDTH_STD } else { LINK_WIDTH_STD };
        let depth_std = if distance_m.is_some() { DEPTH_STD } else { FAR_DEPTH_STD };
        let beyond_std_m =
            if soft { END_STD * mechanism.tip_half_width_m() } else { BEYOND_STD_PX * camera.scale_m };
        let mut prior_std =
            vec![BASE_STD_M, BASE_STD_M, width_std, width_std, depth_std, FACING_DEPTH_STD, beyond_std_m];
        if !soft {
            prior_std.extend(mechanism.half_depths_m().iter().map(|half| half.max(LEAST_FRONT_STD_M)));
        }

        let reduced: Vec<Reduced> = sample.iter().map(|one| one.reduced.clone()).collect();
        let search = Search { mechanism: &mechanism, camera: &camera, shared: &shared };
        let empty = empty.and_then(Planes::of).filter(|empty| [empty.width, empty.height] == size);
        let begins = match &empty {
            Some(empty) => Some(Looks::of_empty(&empty.reduced(by), by)),
            None => Looks::middle(&reduced, by),
        };
        let (looks, found) = begins.and_then(|looks| begin(looks, &reduced, &search)).ok_or_else(nothing)?;
        let best = found.iter().filter_map(|found| found.first()).map(|one| one.score).fold(0.0, f64::max);
        let keys: Vec<usize> = (0..found.len())
            .filter(|&k| found[k].first().is_some_and(|one| one.score > 0.6 * best))
            .collect();
        let rough = |k: &usize| (&sample[*k].planes, &found[*k][0].pose);
        let masks: Vec<Vec<bool>> = keys
            .par_iter()
            .map(|k| painted(&camera, &mechanism.strips(rough(k).1, &shared), 4.0 * by as f64))
            .collect();
        let lit: Vec<(&Planes, Light)> =
            keys.iter().map(|k| (&sample[*k].planes, looks.light(&reduced[*k]))).collect();
        let given = GivenTank { blocked, empty: empty.as_ref() };
        let tank = given.completed(Tank::learn(&lit, &masks, 3).ok_or_else(nothing)?);
        let residuals = Residuals { variance: 1.0, alike: vec![1.0] };
        let known = DMatrix::from_diagonal(&DVector::from_iterator(
            prior_std.len(),
            prior_std.iter().map(|std| std * std),
        ));
        let mut film = Self {
            mechanism,
            camera,
            believed: shared.clone(),
            shared,
            prior_std,
            known,
            tank,
            colours: Vec::new(),
            edges: Edges::new(USUAL_BLUR_PX, [NO_RIM; DIRECTIONS]),
            looks,
            residuals,
            explained: [0, 0],
            continuity: Continuity::default(),
            last: None,
        };
        match end_rounding {
            _ if soft => film.choose_width(&sample, &keys, &found),
            Some(known) => film.mechanism = film.mechanism.rounded(known),
            None => film.choose_ends(&sample, &keys, &found),
        }
        film.settle(&sample, &found, given);
        Ok(film)
    }

    /// How wide a soft body is: the width whose outline the sample likes best.
    fn choose_width(&mut self, sample: &[Sampled], keys: &[usize], found: &[Vec<Candidate>]) {
        let cost = |width: &f64| {
            let shared = Shared { width: [*width; 2], ..self.shared.clone() };
            cost(&Scene { shared: &shared, ..self.scene() }, sample, keys, found)
        };
        if let Some(width) = cheapest_of(TRIED_WIDTHS, cost) {
            self.shared.width = [width; 2];
            self.believed = self.shared.clone();
        }
    }

    /// How round the ends of links are, which their model's solids rarely say: as the sample likes best.
    fn choose_ends(&mut self, sample: &[Sampled], keys: &[usize], found: &[Vec<Candidate>]) {
        let cost = |rounding: &f64| {
            let mechanism = self.mechanism.rounded(*rounding);
            cost(&Scene { mechanism: &mechanism, ..self.scene() }, sample, keys, found)
        };
        if let Some(rounding) = cheapest_of(ROUNDINGS, cost) {
            self.mechanism = self.mechanism.rounded(rounding);
        }
    }

    /// How blurred edges are: what explains the brightness across those of `fits` best.
    fn learn_blur(&mut self, sample: &[Sampled], fits: &[Explained]) {
        let misfits: Vec<Vec<f64>> = sample
            .par_iter()
            .zip(fits)
            .filter(|(_, fit)| fit.agreement() >= LEAST_AGREEMENT)
            .filter_map(|(one, fit)| {
                self.scene().misfits(&one.planes, self.tank.light(&one.planes), fit, &BLURS_PX)
            })
            .collect();
        let sum = |k: usize| misfits.iter().map(|misfits| misfits[k]).sum::<f64>();
        let sums = BLURS_PX.into_iter().enumerate().map(|(k, blur_px)| (blur_px, sum(k)));
        let best = sums.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|_| !misfits.is_empty());
        if let Some((blur_px, _)) = best {
            self.edges = Edges::new(blur_px, self.edges.rims);
        }
    }

    /// Tank, colours and what is shared, in rounds, from all of the sample.
    fn settle(&mut self, sample: &[Sampled], found: &[Vec<Candidate>], given: GivenTank<'_>) {
        /// Rounds, and steps of what is shared in each; chosen.
        const LEARNING_ROUNDS: usize = 3;
        const STEPS: [usize; LEARNING_ROUNDS] = [7, 4, 4];
        let jobs: Vec<(&Planes, &Vec<Candidate>)> = sample.iter().map(|one| &one.planes).zip(found).collect();
        let mut fits: Vec<Explained> = jobs
            .par_iter()
            .map(|(picture, found)| {
                let tried = found.iter().take(2).map(|one| self.explain(picture, &one.pose, None, ROUGH));
                let none = vec![0.0; self.mechanism.links()];
                cheapest(tried).unwrap_or_else(|| self.explain(picture, &none, None, ROUGH))
            })
            .collect();
        let again = |film: &Self, fits: &[Explained]| -> Vec<Explained> {
            sample
                .par_iter()
                .zip(fits)
                .map(|(one, fit)| film.explain(&one.planes, &fit.pose, None, GOOD))
                .collect()
        };
        for (round, steps) in STEPS.into_iter().enumerate() {
            self.learn_tank(sample, &fits, given);
            fits = again(self, &fits);
            self.learn_colours(sample, &fits);
            self.learn_blur(sample, &fits);
            let inside: Vec<(&Planes, Vec<bool>)> = sample
                .par_iter()
                .zip(&fits)
                .filter(|(_, fit)| fit.agreement() > 0.5)
                .map(|(one, fit)| {
                    let strips = self.mechanism.strips(&fit.pose, &self.shared);
                    (&one.planes, painted(&self.camera, &strips, -2.0))
                })
                .collect();
            self.tank.find_before(&inside);
            for step in 0..steps {
                fits = again(self, &fits);
                let change = self.share(&fits, round > 0 || step > 2);
                let is_small = change[0].abs().max(change[1].abs()) < 3e-5
                    && change[2].abs().max(change[3].abs()) < 0.02;
                if is_small {
                    break;
                }
            }
            if self.mechanism.is_soft() {
                self.decide_depth();
            }
            fits = again(self, &fits);
            self.learn_rims(sample, &fits);
        }
        self.learn_colours(sample, &fits);
        fits = again(self, &fits);
        let good: Vec<&Explained> = fits.iter().filter(|fit| fit.agreement() >= LEAST_AGREEMENT).collect();
        self.residuals = Residuals::of(&self.mechanism, &good);
        self.explained = [fits.iter().filter(|fit| is_sound(fit)).count(), fits.len()];
        tracing::debug!(shared = ?self.shared, blur_px = self.edges.blur_px, rims = ?self.edges.rims, residuals = ?self.residuals, "learned a film");
        self.know();
    }

    /// A section that is not the model's says nothing of its depth.
    fn decide_depth(&mut self) {
        let is_models = self.shared.width.iter().all(|width| (width - 1.0).abs() < SAME_SECTION);
        if is_models {
            if self.shared.depth == [0.0; 2] {
                self.shared.depth = [1.0, FACING_DEPTH];
            }
            self.believed.width = [1.0; 2];
            self.believed.depth = [1.0, FACING_DEPTH];
            self.prior_std[WIDTH..BEYOND].copy_from_slice(&[0.04, 0.04, 0.25, FACING_DEPTH_STD]);
        } else {
            self.shared.depth = [0.0; 2];
            self.believed.depth = [0.0; 2];
            self.prior_std[WIDTH..BEYOND].copy_from_slice(&[SOFT_WIDTH_STD, SOFT_WIDTH_STD, 1e-3, 1e-3]);
        }
    }

    fn learn_tank(&mut self, sample: &[Sampled], fits: &[Explained], given: GivenTank<'_>) {
        let grown_px = if self.camera.size[0] > WIDE_PX { 5.0 } else { 4.0 };
        let masks: Vec<Vec<bool>> = fits
            .par_iter()
            .map(|fit| painted(&self.camera, &self.mechanism.strips(&fit.pose, &self.shared), grown_px))
            .collect();
        let lit: Vec<(&Planes, Light)> =
            sample.par_iter().map(|one| (&one.planes, self.tank.light(&one.planes))).collect();
        if let Some(tank) = Tank::learn(&lit, &masks, 4.min(lit.len())) {
            self.tank = given.completed(tank);
        }
    }

    fn learn_colours(&mut self, sample: &[Sampled], fits: &[Explained]) {
        let seen: Vec<Vec<Colour>> = sample
            .par_iter()
            .zip(fits)
            .filter(|(_, fit)| fit.agreement() >= 0.6)
            .map(|(one, fit)| self.scene().colours_inside(&one.planes, self.tank.light(&one.planes), fit))
            .collect();
        let middle: Vec<Colour> =
            (0..self.mechanism.points()).map(|i| medians(seen.iter().filter_map(|image| image[i]))).collect();
        let usual: Colour = medians(middle.iter().flatten().copied());
        let smooth = smoothed(&middle, self.mechanism.runs(), 2);
        self.colours = smooth.into_iter().map(|colour: Option<[f32; PLANES]>| colour.or(usual)).collect();
    }

    /// What rims look like, from all edges of the sample.
    fn learn_rims(&mut self, sample: &[Sampled], fits: &[Explained]) {
        let seen: Vec<Vec<Profile>> = sample
            .par_iter()
            .zip(fits)
            .filter(|(_, fit)| fit.agreement() >= LEAST_AGREEMENT)
            .map(|(one, fit)| self.scene().profiles(&one.planes, self.tank.light(&one.planes), fit))
            .collect();
        let mut all = vec![Profile::default(); DIRECTIONS];
        for profiles in &seen {
            all.iter_mut().zip(profiles).for_each(|(all, one)| all.merge(one));
        }
        let mut rims = self.edges.rims;
        rims.iter_mut().zip(&all).for_each(|(rim, profile)| *rim = profile.rim(self.edges.blur_px));
        self.edges = Edges::new(self.edges.blur_px, rims);
    }

    /// Moves what is shared to where all images together want it: their Schur complements add up. Returns the change.
    fn share(&mut self, fits: &[Explained], is_fine: bool) -> DVector<f64> {
        let (least, own_px) = if is_fine { (0.6, 2.5) } else { (0.25, 5.0) };
        let n = self.mechanism.links();
        let (information, pull) = self.shared_information(fits, least, own_px, n);
        let mut change =
            information.clone().cholesky().map_or_else(|| DVector::zeros(pull.len()), |f| f.solve(&pull));
        for (i, change) in change.iter_mut().enumerate() {
            let most = match i {
                WIDTH..DEPTH => MOST_STEP_WIDTH,
                DEPTH..BEYOND => MOST_STEP_DEPTH,
                _ => MOST_STEP_M,
            };
            *change = change.clamp(-most, most);
        }
        let moved: Vec<f64> = self.shared.numbers().iter().zip(&change).map(|(a, b)| a + b).collect();
        self.shared = Shared::of(&moved);
        if let Some(factors) = information.cholesky() {
            self.known = factors.inverse();
        }
        change
    }

    fn shared_information(
        &self,
        fits: &[Explained],
        least: f64,
        own_px: f64,
        n: usize,
    ) -> (DMatrix<f64>, DVector<f64>) {
        let believed = self.believed.numbers();
        let now = self.shared.numbers();
        let shared = now.len();
        let held = |i: usize| self.prior_std[i].powi(-2);
        let mut information = DMatrix::from_fn(shared, shared, |i, j| if i == j { held(i) } else { 0.0 });
        let mut pull = DVector::from_fn(shared, |i, _| (believed[i] - now[i]) * held(i));
        let own = prior(&self.mechanism);
        let own = own.transpose() * own;
        for fit in fits.iter().filter(|fit| fit.agreement() >= least) {
            let mut all = DMatrix::zeros(n + shared, n + shared);
            let mut wanted = DVector::zeros(n + shared);
            for (i, line) in fit.lines.iter().enumerate() {
                if !line.tells || line.best_px.abs() >= own_px {
                    continue;
                }
                let row = fit.slopes.row(i).transpose();
                all.ger(line.information, &row, &row, 1.0);
                wanted.axpy(line.information * line.residual_px, &row, 1.0);
            }
            let pose = all.view((0, 0), (n, n)) + &own;
            let Some(factors) = pose.cholesky() else { continue };
            let cross = all.view((0, n), (n, shared)).into_owned();
            let at = DVector::from_column_slice(&fit.pose);
            let pose_pull = wanted.rows(0, n) - &own * at;
            let solved = factors.solve(&cross);
            information += (all.view((n, n), (shared, shared)) - cross.transpose() * &solved) * IMAGE_WEIGHT;
            pull += (wanted.rows(n, shared) - solved.transpose() * pose_pull) * IMAGE_WEIGHT;
        }
        (information, pull)
    }

    /// How well what is shared is known in the end: twice as badly as its lines say, and depth never better than its floor.
    fn know(&mut self) {
        self.known *= 4.0;
        // Rims that are lit from one side move all edges towards the light, and nothing in the picture tells that from a shift.
        let lit_px = lit_from(&self.edges.rims);
        let px = self.camera.plane.pixel(self.shared.base);
        let away = [px[0] - LIT_SHIFT * lit_px[0], px[1] - LIT_SHIFT * lit_px[1]];
        self.shared.base = self.camera.plane.metres(away);
        let std_m = LIT_STD * lit_px[0].hypot(lit_px[1]) * self.camera.scale_m;
        for axis in 0..2 {
            self.known[(axis, axis)] += std_m * std_m;
        }
        // what is added to a depth's variance moves the others as they follow it
        for depth in DEPTH..BEYOND {
            let variance = self.known[(depth, depth)];
            let floor = LEAST_DEPTH_STD.min(self.prior_std[depth]).powi(2);
            if variance < floor {
                let follows = self.known.column(depth) / variance;
                self.known.ger(floor - variance, &follows, &follows.clone(), 1.0);
            }
        }
    }
}

/// What every second one of the pictures `keys` costs in `scene`, from where it was `found`.
fn cost(scene: &Scene<'_>, sample: &[Sampled], keys: &[usize], found: &[Vec<Candidate>]) -> f64 {
    let of = |&k: &usize| {
        let picture = &sample[k].planes;
        let light = scene.tank.light(picture);
        scene.explain(picture, light, &found[k][0].pose, None, &[(2.0, 1), (1.0, 2)]).cost
    };
    keys.par_iter().step_by(2).map(of).collect::<Vec<f64>>().iter().sum()
}

fn cheapest_of<T: Copy + std::fmt::Debug>(
    tried: impl IntoIterator<Item = T>,
    cost: impl Fn(&T) -> f64,
) -> Option<T> {
    let costs: Vec<(T, f64)> = tried.into_iter().map(|one| (one, cost(&one))).collect();
    tracing::debug!(?costs, "tried");
    costs.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(one, _)| one)
}

/// What the mechanism and the tank look like in `pictures`, and where it may be in each, the best first.
fn begin(
    mut looks: Looks,
    pictures: &[Reduced],
    search: &Search<'_>,
) -> Option<(Looks, Vec<Vec<Candidate>>)> {
    let mut found: Vec<Vec<Candidate>> = Vec::new();
    for _ in 0..2 {
        found = pictures
            .par_iter()
            .enumerate()
            .map(|(k, picture)| search.best(&looks.evidence(picture), k as u64))
            .collect();
        let best: Vec<Candidate> = found.iter().filter_map(|found| found.first().cloned()).collect();
        if best.len() < pictures.len() {
            return None;
        }
        let mut order: Vec<usize> = (0..best.len()).collect();
        order.sort_by(|&a, &b| best[b].score.total_cmp(&best[a].score));
        order.truncate((best.len() * 7 / 10).max(4));
        looks = looks.learned(pictures, search, &best, &order);
    }
    Some((looks, found))
}
