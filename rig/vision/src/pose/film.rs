//! A film's images through the pose that explains them: what they share is learned from a sample, then each image follows the one before.

mod learning;

pub use learning::Given;

use nalgebra::DMatrix;

use camera::calibration::Px;
use camera::source::TimedImage;

use super::colours::Colour;
use super::edge::Edges;
use super::mechanism::Mechanism;
use super::place::lerp;
use super::search::{Looks, Search};
use super::shared::Shared;
use super::sigma::{Residuals, sigmas_m};
use super::solve::{Expected, Explained, Readings, Scene};
use super::tank::{Planes, Tank, painted};
use super::view::Camera;
use crate::continuity::{Continuity, Marks};
use crate::keypoints::Sigma;
use crate::mask::Mask;
use crate::record::{ImageRecord, Keypoint, Status};
use crate::rejection::Rejection;

/// A film of a held mechanism, as learned, and where the mechanism was last.
#[derive(Debug)]
pub struct PoseFilm {
    mechanism: Mechanism,
    camera: Camera,
    shared: Shared,
    /// Standard deviations of what is shared, before any image is seen.
    prior_std: Vec<f64>,
    /// What was believed of it then.
    believed: Shared,
    /// Covariance of what is shared.
    known: DMatrix<f64>,
    tank: Tank,
    colours: Vec<Colour>,
    edges: Edges,
    looks: Looks,
    residuals: Residuals,
    /// How many images of the sample the model explains, and how many those are.
    explained: [usize; 2],
    continuity: Continuity,
    last: Option<Track>,
}

/// Where the mechanism was in the latest image that was understood.
#[derive(Debug, Clone)]
struct Track {
    time_s: f64,
    pose: Vec<f64>,
    /// \[rad/s\]
    speed: Vec<f64>,
}

/// An image is doubtful where less of the outline tells, where less of that agrees, or where a keypoint is known worse \[px\].
const LEAST_TOLD: f64 = 0.3;
const LEAST_AGREEMENT: f64 = 0.75;
const CERTAIN_PX: f64 = 1.0;
/// How far a pose may be from where the last ones lead, for each 20 ms between images \[rad\]; chosen.
const ARM_STRAY: f64 = 0.06;
const CHAIN_STRAY: f64 = 0.12;
/// A picture of more columns is wide.
const WIDE_PX: usize = 900;

/// Readings from a rough pose, from a predicted one and from a good one.
const ROUGH: Readings<'_> = &[(2.5, 3), (1.0, 2)];
const PREDICTED: Readings<'_> = &[(1.5, 1), (1.0, 2)];
const GOOD: Readings<'_> = &[(1.0, 2)];

impl PoseFilm {
    fn scene(&self) -> Scene<'_> {
        Scene {
            mechanism: &self.mechanism,
            camera: &self.camera,
            shared: &self.shared,
            tank: &self.tank,
            colours: &self.colours,
            edges: &self.edges,
        }
    }

    fn explain(
        &self,
        picture: &Planes,
        start: &[f64],
        expected: Option<Expected<'_>>,
        readings: Readings<'_>,
    ) -> Explained {
        self.scene().explain(picture, self.tank.light(picture), start, expected, readings)
    }

    /// Where P0 is, as the film has it \[px\].
    pub fn base_px(&self) -> Px {
        self.camera.plane.pixel(self.shared.base)
    }

    /// How many images of the sample the model explains, and how many those are.
    pub fn explained(&self) -> [usize; 2] {
        self.explained
    }

    /// What the next image shows.
    pub fn take(&mut self, image: &TimedImage) -> ImageRecord {
        let empty = |reason: String| ImageRecord {
            name: image.name.clone(),
            time_s: image.time_s,
            status: Status::Rejected,
            reason,
            keypoints: Vec::new(),
            mask: None,
            centreline: Vec::new(),
        };
        let picture = match &image.grey {
            Err(why) => return empty(Rejection::Unreadable(why.clone()).to_string()),
            Ok(grey) => match self.continuity.take(Marks::of(grey)) {
                Err(why) => return empty(why.to_string()),
                Ok(()) => Planes::of(image),
            },
        };
        let Some(picture) = picture.filter(|planes| [planes.width, planes.height] == self.camera.size) else {
            let [wanted, got] = [
                self.camera.size,
                image.grey.as_ref().map_or([0; 2], |grey| [grey.width() as usize, grey.height() as usize]),
            ];
            return empty(Rejection::Size { wanted, got }.to_string());
        };
        let explained = self.follow(&picture, image.time_s);
        let sigmas = sigmas_m(
            &self.mechanism,
            &self.shared,
            &self.residuals,
            &explained,
            &self.known,
            self.camera.scale_m,
        );
        let doubt = self.doubt(&explained, sigmas.as_deref());
        if doubt.is_none() {
            self.remember(image.time_s, &explained.pose);
        }
        self.record(image, &explained, sigmas, doubt)
    }

    /// The pose of `picture`: from where the last ones lead, or else from a search.
    fn follow(&self, picture: &Planes, time_s: f64) -> Explained {
        let tracked = self.last.as_ref().map(|last| {
            let since = time_s - last.time_s;
            let ahead: Vec<f64> =
                last.pose.iter().zip(&last.speed).map(|(at, speed)| at + speed * since).collect();
            let stray = if self.mechanism.is_soft() { ARM_STRAY } else { CHAIN_STRAY };
            let std = stray * (since / 0.02).max(1.0);
            self.explain(picture, &ahead, Some((&ahead, std)), PREDICTED)
        });
        if let Some(tracked) = &tracked
            && is_sound(tracked)
        {
            return tracked.clone();
        }
        let search = Search { mechanism: &self.mechanism, camera: &self.camera, shared: &self.shared };
        let evidence =
            self.looks.evidence(&picture.reduced(if self.camera.size[0] > WIDE_PX { 6 } else { 4 }));
        let found = search.best(&evidence, 1);
        let tried = found.iter().take(3).map(|one| self.explain(picture, &one.pose, None, ROUGH));
        let none = vec![0.0; self.mechanism.links()];
        cheapest(tried.chain(tracked)).unwrap_or_else(|| self.explain(picture, &none, None, ROUGH))
    }

    fn remember(&mut self, time_s: f64, pose: &[f64]) {
        let speed = match &self.last {
            Some(last) if time_s > last.time_s => {
                let since = time_s - last.time_s;
                pose.iter()
                    .zip(&last.pose)
                    .zip(&last.speed)
                    .map(|((now, before), speed)| 0.4 * speed + 0.6 * (now - before) / since)
                    .collect()
            }
            _ => vec![0.0; pose.len()],
        };
        self.last = Some(Track { time_s, pose: pose.to_vec(), speed });
    }

    fn doubt(&self, explained: &Explained, sigmas: Option<&[Sigma]>) -> Option<String> {
        if explained.told() < LEAST_TOLD {
            return Some(format!("{:.0} % of its outline are seen only", 100.0 * explained.told()));
        }
        if explained.agreement() < LEAST_AGREEMENT {
            let share = 100.0 * explained.agreement();
            return Some(format!("edges agree with the model on {share:.0} % of its outline only"));
        }
        let Some(sigmas) = sigmas else { return Some("its outline does not tell its pose".into()) };
        let worst = sigmas.iter().map(|sigma| sigma.whole_px / self.camera.scale_m).enumerate();
        worst.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, px)| *px > CERTAIN_PX).map(|(i, px)| {
            format!("P{i} is known to {px:.1} px (1 sigma) only: too little of the mechanism is seen there")
        })
    }

    fn record(
        &self,
        image: &TimedImage,
        explained: &Explained,
        sigmas: Option<Vec<Sigma>>,
        doubt: Option<String>,
    ) -> ImageRecord {
        let plane = &self.camera.plane;
        let places = self.mechanism.keypoints(&explained.pose, self.shared.base);
        let unknown = Sigma { whole_px: f64::NAN, pose_px: f64::NAN };
        let sigmas = sigmas.unwrap_or_else(|| vec![unknown; places.len()]);
        let keypoints = places
            .iter()
            .zip(sigmas)
            .map(|(place, Sigma { whole_px: whole_m, pose_px: film_m })| {
                let px = plane.pixel(*place);
                let scale = plane.metres_per_pixel(px);
                Keypoint::seen(px, Sigma { whole_px: whole_m / scale, pose_px: film_m / scale }, plane)
            })
            .collect();
        let (pivots, _) = self.mechanism.pivots(&explained.pose, self.shared.base);
        ImageRecord {
            name: image.name.clone(),
            time_s: image.time_s,
            status: if doubt.is_some() { Status::Doubtful } else { Status::Ok },
            reason: doubt.unwrap_or_default(),
            keypoints,
            mask: self.mask(&explained.pose),
            centreline: line(&pivots.iter().map(|place| plane.pixel(*place)).collect::<Vec<Px>>()),
        }
    }

    /// The mechanism's silhouette in `pose`.
    fn mask(&self, pose: &[f64]) -> Option<Mask> {
        let [width, height] = self.camera.size;
        let bits = painted(&self.camera, &self.mechanism.strips(pose, &self.shared), 0.0);
        bits.contains(&true).then_some(Mask { left: 0, top: 0, width, height, bits })
    }
}

/// Points about a pixel apart through `corners`.
fn line(corners: &[Px]) -> Vec<Px> {
    let mut points: Vec<Px> = corners.first().copied().into_iter().collect();
    for pair in corners.windows(2) {
        let steps = (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]).ceil().max(1.0) as usize;
        points.extend((1..=steps).map(|i| lerp(pair[0], pair[1], i as f64 / steps as f64)));
    }
    points
}

fn is_sound(explained: &Explained) -> bool {
    explained.told() >= LEAST_TOLD && explained.agreement() >= LEAST_AGREEMENT
}

fn cheapest(tried: impl Iterator<Item = Explained>) -> Option<Explained> {
    tried.min_by(|a, b| a.cost.total_cmp(&b.cost))
}
