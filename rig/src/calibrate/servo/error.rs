//! Why films of a servo make no calibration.

/// Why films of a servo make no calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ServoCalibrateError {
    /// The staircase is not there.
    #[error(
        "the servo was seen at rest {rests} times after a known move, at {levels} pulses; at least {least} times at 3 pulses from both sides are needed: film a staircase (`rig calibrate servo CONFIG`), and see in its report why images were refused"
    )]
    Levels {
        /// Stands seen.
        rests: usize,
        /// Different pulses among them.
        levels: usize,
        /// Least number of stands.
        least: usize,
    },
    /// A longer pulse turns it this way here and that way there.
    #[error(
        "from {from_us} to {to_us} µs the link turns the other way than elsewhere: it runs into something, or the servo's travel ends there; narrow min_pulse_us and max_pulse_us"
    )]
    NotMonotone {
        /// \[µs\]
        from_us: f64,
        /// \[µs\]
        to_us: f64,
    },
    /// Small steps move nothing.
    #[error(
        "the angle depends by {zone_rad:.4} rad on the side from which a level is approached, more than half of the quick steps of {step_rad:.4} rad: tighten the horn, or widen the channel's limits for larger steps"
    )]
    Loose {
        /// \[rad\]
        zone_rad: f64,
        /// \[rad\]
        step_rad: f64,
    },
    /// No film of small steps to and fro.
    #[error("no film shows small steps to and fro about the middle; all films of one calibration are needed")]
    NoSmallSteps,
    /// No film of quick steps.
    #[error(
        "{images} images show quick steps, at least {least} are needed; all films of one calibration are needed"
    )]
    NoQuickSteps {
        /// Images seen during them.
        images: usize,
        /// Least number.
        least: usize,
    },
    /// Nothing in the model is the driven link.
    #[error("the driven link of actuator `{actuator}` cannot be followed: {what}")]
    Link {
        /// The actuator.
        actuator: String,
        /// What is missing.
        what: String,
    },
}
