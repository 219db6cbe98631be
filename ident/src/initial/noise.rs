//! Noise of a run from its images alone, those before its motion above all.

use sim::Trajectory;

use super::release;
use crate::experiment::{Run, RunKind};
use crate::noise::{LEAST_NOISE_M, MOST_CORRELATED, Neighbours, noise_m, third_difference};

/// Fewest still images from which the noise is estimated (chosen): with three keypoints, to some 10 %.
const STILL_IMAGES_MIN: usize = 15;

/// Keypoint noise of one run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunNoise {
    /// Standard deviation of one coordinate \[m\].
    pub std_m: f64,
    /// Correlation of a coordinate's noise from one image to the next, 0 to 1.
    pub correlation: f64,
    /// Still images that it was estimated from; 0: from the roughness of the motion alone.
    pub still_images: usize,
}

/// Noise of `run`: from the images before its motion, where there are enough, and from the roughness of the whole
/// run. Motion blurs and hides, so the larger of both counts; correlation is estimated from still images only.
pub fn run_noise(run: &Run) -> RunNoise {
    let trajectory = &run.trajectory;
    let rough_m = noise_m([trajectory]);
    let start_s = match run.kind {
        RunKind::Drop => run.release_s.or_else(|| release(trajectory, rough_m).map(|found| found.start_s)),
        RunKind::Driven if !run.adrift => run.first_motion_s(),
        RunKind::Driven | RunKind::Free => None,
    };
    let still = start_s.map_or(0, |start_s| trajectory.time_s.iter().take_while(|t| **t < start_s).count());
    let Some((std_m, correlation)) = still_noise(trajectory, still) else {
        return RunNoise { std_m: rough_m, correlation: 0.0, still_images: 0 };
    };
    let rough_m = rough_m * (third_difference(0.0) / third_difference(correlation)).sqrt();
    RunNoise { std_m: std_m.max(rough_m), correlation, still_images: still }
}

/// Standard deviation \[m\] and correlation over the first `still` images, each coordinate about its own mean.
fn still_noise(trajectory: &Trajectory, still: usize) -> Option<(f64, f64)> {
    let (mut squares, mut freedom) = (0.0, 0.0);
    let mut neighbours = Neighbours::default();
    let mut longest = 0;
    for keypoint in 0..trajectory.keypoints.len() {
        for axis in 0..3 {
            let series: Vec<f64> = (0..still).map(|row| trajectory.at(row, keypoint)[axis]).collect();
            let observed: Vec<f64> = series.iter().copied().filter(|x| x.is_finite()).collect();
            if observed.len() < STILL_IMAGES_MIN {
                continue;
            }
            longest = longest.max(observed.len());
            let mean = observed.iter().sum::<f64>() / observed.len() as f64;
            squares += observed.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
            freedom += observed.len() as f64 - 1.0;
            for pair in series.windows(2).filter(|pair| pair[0].is_finite() && pair[1].is_finite()) {
                neighbours.add(pair[0] - mean, pair[1] - mean);
            }
        }
    }
    if freedom == 0.0 {
        return None;
    }
    let raw_correlation = neighbours.correlation();
    // Taking out the mean of n images makes neighbours look (1 + 3 correlation) / n less alike.
    let n = longest as f64;
    let correlation = ((raw_correlation + 1.0 / n) / (1.0 - 3.0 / n)).clamp(0.0, MOST_CORRELATED);
    // The mean has followed correlated noise: fewer degrees of freedom are left.
    let lost = ((1.0 + correlation) / (1.0 - correlation) / n).min(0.5);
    Some(((squares / freedom / (1.0 - lost) * (1.0 - 1.0 / n)).sqrt().max(LEAST_NOISE_M), correlation))
}
