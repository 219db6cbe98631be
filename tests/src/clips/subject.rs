//! What a film shows, and what its maker would write of it.

use ground::strict::{Finite, Positive, Share};
use vision::{Ahead, Mode, VisionConfig};

use super::body::Body;
use super::mechanism::Mechanism;
use super::octopus::Swimming;
use super::shape::{Px, Shape};

/// What is filmed.
#[derive(Debug, Clone, Copy)]
pub enum Subject<'a> {
    /// What hangs from P0.
    Held(&'a Mechanism),
    /// A rigid body, P1 so far ahead \[px\], and which end is ahead as somebody sees it who looks at the first image.
    Free(&'a Body, f64, Ahead),
    /// The octopus, and how it swims.
    Octopus(Swimming),
}

impl Subject<'_> {
    /// In a word.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Held(Mechanism::Arm { .. }) => "arm",
            Self::Held(Mechanism::Chain { .. }) => "chain",
            Self::Free(body, ..) => body.kind,
            Self::Octopus(Swimming::Stroke) => "octopus",
            Self::Octopus(Swimming::Course) => "octopus, turning",
            Self::Octopus(Swimming::Apart) => "octopus, arms apart",
        }
    }

    /// Half the width of the motor that holds it \[px\]; none where nothing does.
    pub fn held(&self) -> Option<f64> {
        match self {
            Self::Held(Mechanism::Chain { half, .. }) => Some(*half),
            Self::Held(Mechanism::Arm { half, .. }) => Some(half[0]),
            Self::Free(..) | Self::Octopus(_) => None,
        }
    }

    /// Whether it comes so near to `thing` that it may be covered by it, or merge with it; `points` are its keypoints.
    pub fn meets(&self, points: &[Px], thing: &Shape) -> bool {
        /// Where a blurred edge ends \[px\].
        const SKIRT_PX: f64 = 4.0;
        match self {
            // Its arms say themselves what is not seen of them.
            Self::Held(_) | Self::Octopus(_) => false,
            Self::Free(body, ..) => thing.distance(points[0]) < body.reach + SKIRT_PX,
        }
    }

    /// As whoever made the film would write it: what a calliper tells, but not how far links reach past their pivots.
    pub fn config(&self, scale: f64, click: [Option<Finite>; 2]) -> VisionConfig {
        let base_px = match click {
            [Some(column), Some(row)] => Some([column, row]),
            _ => None,
        };
        match self {
            Self::Held(Mechanism::Chain { lengths, .. }) => VisionConfig {
                link_lengths_m: lengths.iter().map(|length| Positive::new(length * scale)).collect(),
                base_px,
                ..VisionConfig::new(lengths.len(), Mode::Links)
            },
            Self::Held(Mechanism::Arm { shares, .. }) => VisionConfig {
                shares: shares.iter().map(|share| Share::new(*share)).collect(),
                base_px,
                ..VisionConfig::new(shares.len(), Mode::Arc)
            },
            Self::Octopus(_) => VisionConfig::default(),
            Self::Free(_, ahead_px, ahead) => VisionConfig {
                heading_m: Positive::new(ahead_px * scale),
                ahead: *ahead,
                mode: Some(Mode::Centroid),
                ..VisionConfig::default()
            },
        }
    }
}
