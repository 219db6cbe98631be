//! From an experiment to a calibrated model.
//!
//! A fit estimates where and when each run starts ([`crate::initial`]), seeks the parameters at which the
//! simulated keypoints are nearest to the measured ones, and says how sure it is. What it minimises is the
//! sum of squared residuals in standard deviations plus the priors; with one noise for all and no priors that is
//! the paper's mean squared error times a constant.
//!
//! # Methods
//! * `paper`: CMA-ES as published. Standard deviations stated by a trajectory are ignored: every image and
//!   keypoint counts alike. What the paper leaves open is chosen thus:
//!   * *search space*: the bounds mapped to the unit box ([`crate::parameters::Scale`]);
//!   * *start*: the model's own values; *first step*: 0.2 of the box; *population*: 4 + 3 ln D, up to the next
//!     multiple of 8, which with AVX takes no longer;
//!   * *bounds*: candidates are folded back into the box, which needs no penalty weight;
//!   * *bounds' size*: fluid coefficients 0 to 10, joints by what would stop the mechanism (see there);
//!   * *convergence*: the stop criteria of [`crate::cmaes`] at a loss share of 1e-8, or `max_evaluations`;
//!   * *initial poses and release times*: fitted by least squares at anchor points and eliminated in between
//!     by linearisation, so that D stays the number of parameters and a candidate costs one simulation per run;
//!   * *evaluation cache*: none, since candidates drawn from a continuum do not come twice;
//!   * *several runs*: their images are pooled; *diverging candidates* rank last.
//! * `cma-es`: the same search, with stated standard deviations.
//! * `least-squares`: Levenberg-Marquardt from the model's values, starts and parameters together.
//! * `hybrid`: least squares from the model's values with loose joints (one that dry friction holds has no slope that would
//!   lead out of there, one that moves too easily has); as long as more than the keypoints' noise is left, least squares
//!   from the model's own values, a short search from the best point so far, and least squares from the best point of
//!   the search and from the best of some points drawn evenly. The search, and each descent as far as that leads, is on a rough
//!   form of the data: fewer images, coarser steps. The best end counts; [`Fit::starts`] says whether the others agree. Who has
//!   fitted the first part of the runs while the rest was filmed begins with what that came to ([`WarmStart`]) instead.
//!
//! # How sure
//! Standard deviations rest on the sensitivities at the optimum, the noise each run's residuals show and its
//! correlation in time; the starts of the runs are projected out. A parameter is called determined when its
//! deviation without priors is at most a third of its value, or of its scale's resolution, and well inside the
//! bounds; `profile = true` adds intervals that need no linearity. Where two or more runs see a parameter, their
//! values are compared.
//!
//! Every method gives the same bytes for any number of threads, and goes on from a [`Checkpoint`] to the
//! result it would have reached uninterrupted.

mod checkpoint;
mod constancy;
pub(crate) mod counts;
mod covariance;
pub(crate) mod crossing;
pub(crate) mod driver;
mod error;
mod finish;
mod fitted;
pub(crate) mod least_squares;
mod noise;
pub(crate) mod objective;
pub(crate) mod problem;
mod profile;
mod recalibrate;
pub(crate) mod repeat;
mod report;
mod rest;
mod rough;
mod run;
mod search;
mod steadied;
mod warm_start;

pub use checkpoint::{Checkpoint, CheckpointError, Flow, INTERRUPTED, Observer, Origin, Progress};
pub use error::FitError;
pub use fitted::{Fitted, FittedRun, Timing};
pub use recalibrate::recalibrate;
pub use report::{
    Combination, Constancy, Drift, FirstTouch, Fit, FittedParameter, JointInformation, NoiseEstimate,
    NoiseSource, Recalibration, RunErrors, RunValue, StartLoss,
};
pub use run::{first_answer, fit, resume};
pub use warm_start::WarmStart;
