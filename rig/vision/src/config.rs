//! The `[vision]` table.

use std::path::{Path, PathBuf};

use ground::strict::{NonNegative, Positive, Share};
use serde::{Deserialize, Serialize};

use super::VisionError;
use super::sam2::{Sam2Config, Segmenter};
use camera::calibration::Px;
use camera::decode::{Picture, picture_file};

/// Where the keypoints between the two ends lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// A chain of straight links fitted to the silhouette's edge: rigid mechanisms.
    Links,
    /// Shares of the arc length of the whole centreline: soft arms.
    Arc,
    /// Equal shares of the raw medial path, whose ends stop short and which cuts corners: as published.
    Paper,
    /// A rigid body that nothing holds: P0 its centroid, P1 a point ahead of it; a round body has no P1.
    Centroid,
    /// Arms on one body that nothing holds, as the model has them: P0 of the body, `a1P0`, `a1P1` and so on of the arms.
    Arms,
}

impl Mode {
    /// Whether nothing holds what is seen.
    pub fn is_free(self) -> bool {
        matches!(self, Self::Centroid | Self::Arms)
    }
}

/// Which end of a free body is ahead.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ahead {
    /// The blunt one, as a fish's head.
    #[default]
    Blunt,
    /// The pointed one.
    Pointed,
    /// The one on the right in the first image.
    Right,
    /// The one on the left in the first image.
    Left,
    /// The upper one in the first image.
    Up,
    /// The lower one in the first image.
    Down,
}

/// Whether the mechanism is darker or brighter than the tank.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Polarity {
    /// Darker.
    Dark,
    /// Brighter.
    Bright,
    /// Whichever there is more of, away from the background.
    #[default]
    Auto,
}

/// What the empty tank looks like.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Background {
    /// `temporal`, for images of several sizes `flat`. What never moves and is as dark as the mechanism is taken for a part of it, or
    /// for something of the tank's before or behind it, whichever explains the images.
    #[default]
    Auto,
    /// What each pixel shows while the mechanism is elsewhere.
    Temporal,
    /// A smooth surface through each image's own background.
    Flat,
    /// A picture of the empty tank: any other text is its path.
    #[serde(untagged)]
    Picture(PathBuf),
}

/// How keypoints are found in images: the `[vision]` table.
///
/// Lengths in the picture are pixels, lengths of the mechanism metres. Defaults marked *guessed* are ours and
/// unmeasured on real tanks.
///
/// What the mechanism's shape is (`links` to `shares`) comes from the model where the table leaves it out
/// ([`Outline`](super::outline::Outline)).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VisionConfig {
    /// Number of links n: keypoints are P0..Pn. From 1 to 64.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub links: Option<usize>,
    /// How they are placed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mode: Option<Mode>,
    /// Mode `links`: pivot-to-pivot lengths \[m\], the last one to the tip. Without a model: equal and fitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub link_lengths_m: Option<Vec<Positive>>,
    /// Mode `links`: how far a link reaches past its pivots \[m\], half the overlap of two links. Without a model: estimated
    /// from the images.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overhang_m: Option<NonNegative>,
    /// Mode `links`: radius of the free ends' corners as a share of the half width: 0 square, 1 round. Without a model:
    /// whichever explains the images better.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end_rounding: Option<Share>,
    /// Mode `arc`: P1..Pn at these shares of the arc length, rising. Without a model: equal steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shares: Option<Vec<Share>>,
    /// P0, roughly \[px\]. Tells base from tip, and holds P0 where it is hidden. Left out: where the model holds it; without one
    /// the upper end in the first image, then the end that lies nearer to it from image to image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_px: Option<[ground::strict::Finite; 2]>,
    /// How well `base_px` is known, 1 sigma \[px\]; counts in mode `links` where the base is hidden.
    /// Default 5 (guessed).
    #[serde(default = "base_std")]
    pub base_std_px: Positive,
    /// How far the camera is from the plane of motion \[m\], as far as perspective goes: the way in air, and those in glass over 1.52 and in
    /// water over 1.333. Left out: about 0.5, and not relied on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera_distance_m: Option<Positive>,
    /// A picture, white where the mechanism never is (bracket, screws). Path beside the config.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub static_mask: Option<PathBuf>,
    /// `dark`, `bright` or `auto` (default).
    #[serde(default)]
    pub polarity: Polarity,
    /// `auto` (default), `temporal`, `flat`, or the path of a picture of the empty tank beside the config.
    #[serde(default)]
    pub background: Background,
    /// Smallest silhouette \[px\]; smaller dark spots are dirt. Default 100 (guessed).
    #[serde(default = "min_area")]
    pub min_area_px: Positive,
    /// Largest hole, as a share of the silhouette, that is filled (a screw's glint); a larger one means that
    /// the mechanism touches itself: rejected. Default 0.03 (guessed).
    #[serde(default = "hole_share")]
    pub hole_share: Share,
    /// Smoothing length of the centreline, as a multiple of the silhouette's half width. Default 0.4.
    #[serde(default = "smoothing")]
    pub smoothing: Positive,
    /// Mode `centroid`: how far ahead of P0 P1 is put \[m\]. Without it, and without a model that has both: half of the body's length,
    /// from the images.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading_m: Option<Positive>,
    /// Mode `centroid`: which end is ahead, `blunt` (default), `pointed`, or the one that is `right`, `left`, `up` or `down` in the first
    /// image, for bodies whose ends look alike.
    #[serde(default)]
    pub ahead: Ahead,
    /// Mode `arc`: the centreline stops this many mean half widths short of both ends. Default 0, end to end, for
    /// what is held at `base_px`; 0.9 for a body that nothing holds, whose ends are round: its midline runs from the
    /// centre of one cap to the other's, as trackers of animals have it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end_inset: Option<NonNegative>,
    /// `pose`: the model's pose that explains the picture; `classical`: what differs from the empty tank; `sam2`: recorded films only, see
    /// `sam2`; `auto` (default): `pose` for what can be posed, else `classical`.
    #[serde(default)]
    pub segmenter: Segmenter,
    /// Graphs and clicks of `segmenter = "sam2"`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sam2: Option<Sam2Config>,
    /// Whether a film is drawn again, once it is read, and read again, to tell how far off its keypoints are; takes about as long as reading
    /// it and learning from it four times more. Default false.
    #[serde(default)]
    pub self_check: bool,
    /// When to refuse an image.
    #[serde(default)]
    pub gates: Gates,
}

/// When an image is refused or doubted: the `[vision.gates]` table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Gates {
    /// Largest departure of the centreline's length from the usual one, as a share. Default 0.15 (guessed).
    pub length: Share,
    /// The same of the mean width. Default 0.25 (guessed).
    pub width: Share,
    /// The same of the silhouette's area. Default 0.25 (guessed).
    pub area: Share,
    /// Smallest overlap (intersection over union) of the silhouette with the shape drawn again from centreline
    /// and widths, or from the fitted links. Default 0.85 (guessed).
    pub overlap: Share,
    /// An image is doubtful when another object, cut by the picture's border, is at least this share of the
    /// silhouette's area: it may be a part of the mechanism. Default 0.003 (guessed).
    pub cut_object: Share,
    /// Without `base_px`, images are rejected from one in which such an object reaches this share, for as long as
    /// `cut_object` is reached: which is the mechanism is not certain. Default 0.02, from a crawling worm.
    pub intruder: Share,
    /// An image is doubtful when it follows more rejected ones than this and nothing but the image before tells
    /// base from tip. Default 10 (guessed).
    pub longest_gap: usize,
}

impl Default for Gates {
    fn default() -> Self {
        Self {
            length: share(0.15),
            width: share(0.25),
            area: share(0.25),
            overlap: share(0.85),
            cut_object: share(0.003),
            intruder: share(0.02),
            longest_gap: 10,
        }
    }
}

/// Most links a mechanism may have.
const MAX_LINKS: usize = 64;

impl Default for VisionConfig {
    fn default() -> Self {
        Self {
            links: None,
            mode: None,
            link_lengths_m: None,
            overhang_m: None,
            end_rounding: None,
            shares: None,
            base_px: None,
            base_std_px: base_std(),
            camera_distance_m: None,
            static_mask: None,
            polarity: Polarity::default(),
            background: Background::default(),
            min_area_px: min_area(),
            hole_share: hole_share(),
            smoothing: smoothing(),
            end_inset: None,
            segmenter: Segmenter::default(),
            sam2: None,
            heading_m: None,
            ahead: Ahead::default(),
            self_check: false,
            gates: Gates::default(),
        }
    }
}

impl VisionConfig {
    /// A config with every other key left out.
    pub fn new(links: usize, mode: Mode) -> Self {
        Self { links: Some(links), mode: Some(mode), ..Self::default() }
    }

    /// Checks what single keys cannot say about themselves, for a mechanism of so many `links`.
    ///
    /// # Errors
    /// [`VisionError::Config`] naming the keys.
    pub fn check(&self, links: usize) -> Result<(), VisionError> {
        let refuse = |what: String| Err(VisionError::Config { what });
        if links == 0 || links > MAX_LINKS {
            return refuse(format!("links = {links} must be between 1 and {MAX_LINKS}"));
        }
        if let Some(lengths) = &self.link_lengths_m
            && lengths.len() != links
        {
            return refuse(format!("link_lengths_m has {} entries for links = {links}", lengths.len()));
        }
        if let Some(shares) = &self.shares {
            if shares.len() != links {
                return refuse(format!("shares has {} entries for links = {links}", shares.len()));
            }
            if shares[0].get() <= 0.0 || shares.windows(2).any(|pair| pair[0] >= pair[1]) {
                return refuse("shares must rise strictly from above 0".into());
            }
        }
        match (self.segmenter, &self.sam2) {
            (Segmenter::Sam2, None) => {
                refuse("segmenter = \"sam2\" needs the table [vision.sam2]: weights, clicks".into())
            }
            (Segmenter::Sam2, Some(sam2)) => {
                sam2.fault().map_or(Ok(()), |fault| refuse(format!("sam2: {fault}")))
            }
            (Segmenter::Auto | Segmenter::Classical | Segmenter::Pose, _) => Ok(()),
        }
    }

    /// What SAM 2 is to do, where it is to segment.
    pub fn sam2(&self) -> Option<&Sam2Config> {
        self.sam2.as_ref().filter(|_| self.segmenter == Segmenter::Sam2)
    }

    /// How many mean half widths short of its ends the centreline stops, see the key.
    pub fn end_inset(&self, mode: Mode, held: bool) -> f64 {
        /// The centre of a round end is one half width in; a body narrows towards it.
        const ROUND_END_INSET: f64 = 0.9;
        match self.end_inset {
            _ if mode != Mode::Arc => 0.0,
            Some(inset) => inset.get(),
            None if held => 0.0,
            None => ROUND_END_INSET,
        }
    }

    /// [`Self::base_px`] as plain numbers.
    pub fn base(&self) -> Option<Px> {
        self.base_px.map(|[x, y]| [x.get(), y.get()])
    }
}

fn share(value: f64) -> Share {
    Share::new(value).unwrap_or_else(|| unreachable!("{value} is a share"))
}

fn positive(value: f64) -> Positive {
    Positive::new(value).unwrap_or_else(|| unreachable!("{value} is positive"))
}

fn base_std() -> Positive {
    positive(5.0)
}

fn min_area() -> Positive {
    positive(100.0)
}

fn hole_share() -> Share {
    share(0.03)
}

fn smoothing() -> Positive {
    positive(0.4)
}

/// Reads the picture at `path` in `folder`, which the option `key` names; it must have the images' `size`, width and height \[px\].
pub(super) fn picture(
    key: &'static str,
    folder: &Path,
    path: &Path,
    size: (u32, u32),
) -> Result<Picture, VisionError> {
    let refuse = |what: String| VisionError::Picture { key, path: path.into(), what };
    let bytes = std::fs::read(folder.join(path)).map_err(|error| refuse(error.to_string()))?;
    let picture = picture_file(&bytes).map_err(|error| refuse(error.to_string()))?;
    match picture.grey.dimensions() {
        got if got == size => Ok(picture),
        (width, height) => {
            Err(refuse(format!("{width}x{height} px, but the images have {}x{}", size.0, size.1)))
        }
    }
}
