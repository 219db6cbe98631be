//! Why a film of a servo makes no calibration.

/// Why a film of a servo makes no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ServoCalibrateError {
    /// The film shows too few levels of the staircase.
    #[error(
        "the servo was seen at rest {rests} times after a known move, at {levels} pulses; at least {least} times at 3 pulses from both sides are needed: film a staircase (`rig calibrate servo CONFIG`), and see in its frames.csv why images were refused"
    )]
    Levels {
        /// Number of stands that the film shows.
        rests: usize,
        /// Different pulses among them.
        levels: usize,
        /// Least number of stands.
        least: usize,
    },
    /// The direction of turning changes along the range of pulses.
    #[error(
        "from {from_us} to {to_us} µs the link turns the other way than elsewhere: it runs into something, or the servo's travel ends there; narrow min_pulse_us and max_pulse_us"
    )]
    NotMonotone {
        /// Lower pulse \[µs\].
        from_us: f64,
        /// Upper pulse \[µs\].
        to_us: f64,
    },
    /// The dead zone is too wide for the small steps.
    #[error(
        "the angle depends by {zone_rad:.4} rad on the side from which a level is approached, more than half of the steps of {step_rad:.4} rad: tighten the horn, or widen the channel's limits for larger steps"
    )]
    Loose {
        /// Width of the dead zone \[rad\].
        zone_rad: f64,
        /// Median size of the steps \[rad\].
        step_rad: f64,
    },
    /// Nothing moves, or too few images show it.
    #[error(
        "{images} images show how the servo follows, at least {least} are needed: see in frames.csv why images were refused"
    )]
    NoMoves {
        /// Number of images that show the motion.
        images: usize,
        /// Smallest number that is enough.
        least: usize,
    },
    /// Nothing in the model is the driven link.
    #[error("the driven link of actuator `{actuator}` cannot be followed: {what}")]
    Link {
        /// Name of the actuator.
        actuator: String,
        /// What is missing.
        what: String,
    },
}
