//! Why answers make no rig.

use ident::weights::WeightError;

/// Why no rig can be made of the answers. Each names the option at fault.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// A number that cannot be.
    #[error("--{option} {got} is not between {least} and {most} {unit}")]
    Range {
        /// The option.
        option: &'static str,
        /// What was answered.
        got: f64,
        /// Smallest.
        least: f64,
        /// Largest.
        most: f64,
        /// Unit.
        unit: &'static str,
    },
    /// Pivots that do not follow each other.
    #[error(
        "--overlap-m {overlap_m} must be less than --length-m {length_m}: pivots are length - overlap apart"
    )]
    Overlap {
        /// \[m\]
        overlap_m: f64,
        /// \[m\]
        length_m: f64,
    },
    /// Neither one weight nor one for each link.
    #[error("--{option} has {got} weights for {links} links: give one for all, or one for each")]
    Count {
        /// The option.
        option: &'static str,
        /// Weights.
        got: usize,
        /// Links.
        links: usize,
    },
    /// A weight in water alone says nothing.
    #[error(
        "--wet-mass-kg says what the water carries only together with --dry-mass-kg: weigh the links in air too"
    )]
    WetAlone,
    /// Water takes weight away.
    #[error(
        "--wet-mass-kg {wet_kg} of link{link} is not below its --dry-mass-kg {dry_kg}: water takes weight away"
    )]
    HeavierInWater {
        /// Which, from 1.
        link: usize,
        /// \[kg\]
        wet_kg: f64,
        /// \[kg\]
        dry_kg: f64,
    },
    /// Weights and section do not go together.
    #[error(
        "link{link} displaces {weighed_kg:.6} kg of water by its weights, and {section_kg:.6} kg by --length-m, --width-m and --thickness-m: \
         measure both again; a hollow link that fills with water is weighed full"
    )]
    Displaced {
        /// Which, from 1.
        link: usize,
        /// By its weights \[kg\].
        weighed_kg: f64,
        /// By its shape \[kg\].
        section_kg: f64,
    },
    /// What hangs must sink.
    #[error(
        "link{link} weighs {dry_kg:.6} kg and displaces {displaced_kg:.6} kg of water, so it floats, and --mount hanging needs links that \
         sink: check --dry-mass-kg or --density-kg-per-m3, or mount it upright"
    )]
    Floats {
        /// Which, from 1.
        link: usize,
        /// \[kg\]
        dry_kg: f64,
        /// \[kg\]
        displaced_kg: f64,
    },
    /// What stands must float.
    #[error(
        "link{link} weighs {dry_kg:.6} kg and displaces {displaced_kg:.6} kg of water, so it sinks, and --mount upright needs links that \
         float: check --dry-mass-kg or --density-kg-per-m3 (hollow links), or mount it hanging"
    )]
    Sinks {
        /// Which, from 1.
        link: usize,
        /// \[kg\]
        dry_kg: f64,
        /// \[kg\]
        displaced_kg: f64,
    },
    /// Nothing pulls it anywhere.
    #[error(
        "--motion drop with --mount horizontal: nothing would move it when the hand lets go; mount it hanging or upright, or drive it"
    )]
    Motionless,
    /// It does not fit into the picture.
    #[error(
        "at --metres-per-pixel {metres_per_pixel} the chain of {chain_m:.4} m is {seen_px:.0} px long in a picture {height_px} px high: check \
         --metres-per-pixel, or move the camera away"
    )]
    OutOfPicture {
        /// \[m/px\]
        metres_per_pixel: f64,
        /// End to end \[m\].
        chain_m: f64,
        /// \[px\]
        seen_px: f64,
        /// \[px\]
        height_px: u32,
    },
    /// An image takes longer than the time between two.
    #[error("--exposure-s {exposure_s} is longer than the time between two images at --fps {fps}")]
    Exposure {
        /// \[s\]
        exposure_s: f64,
        /// \[1/s\]
        fps: f64,
    },
    /// Water that nobody knows.
    #[error(transparent)]
    Water(#[from] WeightError),
}
