//! Takes out of residuals what the noise before them tells.
//!
//! The noise of a coordinate is a first-order autoregression: what is correlated by rho from one image to the next is by
//! rho^d over d times the usual time between images. Each residual minus what the one before says of it, over the root of
//! what is left of its variance, is white; the same linear map on derivatives makes least squares the maximum of the
//! likelihood.

use crate::loss::Observation;

/// The map for the observations of one run.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Whitening {
    /// For each observation the one before of the same coordinate.
    before: Vec<Option<Link>>,
}

/// How an observation's noise hangs on an earlier one's.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Link {
    earlier: usize,
    correlation: f64,
    /// One over the root of what the earlier one leaves of its variance.
    scale: f64,
}

/// Correlations are believed up to here: with 1, whitening would divide by nothing.
const MOST_CORRELATED: f64 = 0.999;

impl Whitening {
    /// For `observations` of images at `time_s` \[s\] with `correlation` over `interval_s` \[s\].
    pub(crate) fn new(
        observations: &[Observation],
        time_s: &[f64],
        correlation: f64,
        interval_s: f64,
    ) -> Self {
        let width = observations.iter().map(|o| o.keypoint + 1).max().unwrap_or(0);
        let mut last: Vec<Option<usize>> = vec![None; 3 * width];
        let mut before = Vec::with_capacity(observations.len());
        for (row, observation) in observations.iter().enumerate() {
            let series = &mut last[3 * observation.keypoint + observation.axis];
            before.push(series.map(|earlier| {
                let apart_s = time_s[observation.instant] - time_s[observations[earlier].instant];
                let correlation = correlation.powf(apart_s / interval_s).clamp(0.0, MOST_CORRELATED);
                Link { earlier, correlation, scale: (1.0 - correlation * correlation).sqrt().recip() }
            }));
            *series = Some(row);
        }
        Self { before }
    }

    /// Whitens `numbers`, one an observation.
    pub(crate) fn apply(&self, numbers: &mut [f64]) {
        for row in (0..numbers.len()).rev() {
            if let Some(Link { earlier, correlation, scale }) = self.before[row] {
                numbers[row] = (numbers[row] - correlation * numbers[earlier]) * scale;
            }
        }
    }

    /// Logarithm of the determinant of the noise's correlation matrix.
    pub(crate) fn ln_determinant(&self) -> f64 {
        -2.0 * self.before.iter().flatten().map(|link| link.scale.ln()).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whitened_columns_have_the_inverse_correlation_as_their_product() {
        let at = |instant: usize| Observation { instant, keypoint: 0, axis: 0, measured_m: 0.0, per_m: 1.0 };
        let time_s = [0.0, 0.01, 0.02, 0.05];
        let (rho, list): (f64, Vec<_>) = (0.6, (0..4).map(at).collect());
        let whitening = Whitening::new(&list, &time_s, rho, 0.01);
        let matrix = nalgebra::DMatrix::from_fn(4, 4, |i, j| rho.powf((time_s[i] - time_s[j]).abs() / 0.01));
        let mut white = nalgebra::DMatrix::<f64>::identity(4, 4);
        white.column_iter_mut().for_each(|mut column| whitening.apply(column.as_mut_slice()));
        let unity = &white * &matrix * white.transpose();
        assert!((unity - nalgebra::DMatrix::identity(4, 4)).amax() < 1e-12);
        assert!((whitening.ln_determinant() - matrix.determinant().ln()).abs() < 1e-12);
    }
}
