//! How large the noise of keypoints is, and how long it lasts: from paths alone ([`noise_m`]), or from what a simulation leaves of
//! them ([`floor`]).

mod correlation;
pub(crate) mod floor;
pub(crate) mod pose;
mod roughness;
pub(crate) mod stamps;
mod whitening;

pub(crate) use correlation::{MOST_CORRELATED, Neighbours, correlated, correlation, lasting, series};
pub(crate) use roughness::{LEAST_NOISE_M, calm_noise_m, noise_m, third_difference};
pub(crate) use whitening::Whitening;
