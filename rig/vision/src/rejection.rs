//! Why an image has no keypoints.

/// Why an image has no keypoints.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Rejection {
    /// The picture's file could not be read.
    #[error("unreadable: {0}")]
    Unreadable(String),
    /// Hardly exposed.
    #[error("dark: its middle grey level is {grey:.0}, usually {usual:.0}")]
    Dark {
        /// The middle grey level.
        grey: f64,
        /// That of the sequence.
        usual: f64,
    },
    /// Exposed too much.
    #[error("saturated: {:.0} % of its pixels are as light as can be", share * 100.0)]
    Saturated {
        /// Share of the pixels.
        share: f64,
    },
    /// A picture handed out twice.
    #[error("the same picture as an image before: it was not exposed when it says")]
    Repeated,
    /// Parts of two pictures.
    #[error("torn: {rows} rows together are those of an image before")]
    Torn {
        /// How many.
        rows: usize,
    },
    /// Another size than the background's.
    #[error("image is {}x{} px, its background {}x{} px", got[0], got[1], wanted[0], wanted[1])]
    Size {
        /// Background width and height \[px\].
        wanted: [usize; 2],
        /// Image width and height \[px\].
        got: [usize; 2],
    },
    /// Nothing of the wanted size stands out, or nearly everything does.
    #[error("{area_px} px differ from the background by more than {least:.1} grey levels: no silhouette")]
    NoContrast {
        /// What noise alone reaches \[grey levels\].
        least: f32,
        /// How much exceeds it \[px\].
        area_px: usize,
    },
    /// No connected part is large enough.
    #[error("no connected dark part of at least {min_area_px:.0} px")]
    NothingThere {
        /// The limit \[px\].
        min_area_px: f64,
    },
    /// What is followed is not found.
    #[error("SAM 2 finds nothing of what was clicked")]
    NotSegmented,
    /// The silhouettes were given, but not this image's.
    #[error("no silhouette was stored for this image")]
    NoMask,
    /// The given silhouette is of another picture.
    #[error("stored silhouette reaches to {}x{} px, the image has {}x{} px", got[0], got[1], wanted[0], wanted[1])]
    MaskSize {
        /// Image width and height \[px\].
        wanted: [usize; 2],
        /// What the silhouette needs \[px\].
        got: [usize; 2],
    },
    /// It is not seen whole.
    #[error("cut by {by}: it is not seen whole")]
    Cut {
        /// What cuts it.
        by: &'static str,
    },
    /// The silhouette encloses background.
    #[error("touches itself: encloses {hole_px} px of background, limit {limit_px}")]
    Closed {
        /// Size of the largest hole \[px\].
        hole_px: usize,
        /// Largest hole allowed \[px\].
        limit_px: usize,
    },
    /// Two parts of the silhouette are too near each other to say that they do not touch.
    #[error("nearly touches itself: a gap of at most {gap_px} px closes a loop")]
    Contact {
        /// Gap \[px\].
        gap_px: usize,
    },
    /// Something else of unknown extent is in sight, and no base tells the mechanism from it.
    #[error(
        "another object, cut by the picture's border ({object_px} px of it are seen), may be the mechanism or a part \
         of it; base_px would tell"
    )]
    Intruder {
        /// What is seen of it \[px\].
        object_px: usize,
    },
    /// A blob has no direction.
    #[error(
        "silhouette is {length_px:.0} px long at a half width of {half_width_px:.1} px: no line to follow"
    )]
    NotLong {
        /// Length of the thinned path \[px\].
        length_px: f64,
        /// Its median half width \[px\].
        half_width_px: f64,
    },
    /// Edges are missing or merge with something.
    #[error("only {:.0} % of the centreline has an edge on both sides", share * 100.0)]
    NoEdges {
        /// Share of the line.
        share: f64,
    },
    /// A size jumped.
    #[error("{what} is {got:.1} px, usually {usual:.1} px: off by more than {:.0} %", limit * 100.0)]
    Unusual {
        /// Length, width or area.
        what: &'static str,
        /// This image's \[px\].
        got: f64,
        /// The median of the sequence \[px\].
        usual: f64,
        /// Largest share it may depart by.
        limit: f64,
    },
    /// The shape drawn again from the result is not the silhouette.
    #[error("redrawn shape overlaps the silhouette by {overlap:.2}, limit {limit:.2}")]
    Overlap {
        /// Intersection over union.
        overlap: f64,
        /// Least allowed.
        limit: f64,
    },
    /// The links' fit did not settle.
    #[error("fitting {links} links to {points} edge points did not settle")]
    NoFit {
        /// Number of links.
        links: usize,
        /// Number of edge points.
        points: usize,
    },
    /// The mechanism's outline is not where it should be.
    #[error("{}", no_outline(*part, *found, *open))]
    NoOutline {
        /// The part that is not found, from the base; none for the whole.
        part: Option<usize>,
        /// Places of it where an edge is.
        found: usize,
        /// Places of it that nothing hides.
        open: usize,
    },
}

fn no_outline(part: Option<usize>, found: usize, open: usize) -> String {
    let of = part.map_or("the mechanism".to_owned(), |part| format!("its part {} from the base", part + 1));
    match open {
        0 => format!("the outline of {of} is not found where it should be"),
        _ => format!(
            "an edge is seen at {found} of {open} places of the outline of {of}: something is in the way, or it is elsewhere"
        ),
    }
}
