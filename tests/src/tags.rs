//! An aprilgrid in the water before [`crate::wall::WallCamera`], as Kalibr prints it.

use calibrate::tag36h11::CODES;
use nalgebra::{Rotation2, Vector2};

use crate::wall::{Place, Sheet};

/// An aprilgrid in the plane of motion.
#[derive(Debug, Clone)]
pub struct PlacedTags {
    /// Tags along the lower side, and rows.
    pub tags: [usize; 2],
    /// Side of a tag \[m\].
    pub tag_m: f64,
    /// Gap between tags, as a share of a side.
    pub spacing: f64,
    /// Where its middle lies, as [`crate::wall::WallCamera::traced`] counts \[m\].
    pub middle: Place,
    /// How it is turned \[rad\].
    pub turn_rad: f64,
    /// How much farther from the camera it lies \[m\].
    pub behind_m: f64,
    /// Whether it is seen in a mirror.
    pub mirrored: bool,
    /// Tags that a sheet of paper lies on.
    pub hidden: Vec<usize>,
}

/// Black ink.
const BLACK: f64 = 0.1;
/// Paper.
const WHITE: f64 = 1.0;
/// The sheet that lies on hidden tags.
const COVER: f64 = 0.7;
/// Cells along a tag's side, and of them the border's.
const CELLS: f64 = 10.0;
const BORDER: f64 = 2.0;

impl PlacedTags {
    /// Whole, turned by nothing, in the plane of motion.
    pub fn new(tags: [usize; 2], tag_m: f64, spacing: f64, middle: Place) -> Self {
        Self {
            tags,
            tag_m,
            spacing,
            middle,
            turn_rad: 0.0,
            behind_m: 0.0,
            mirrored: false,
            hidden: Vec::new(),
        }
    }

    /// Width and height without the squares around \[sides\].
    fn size(&self) -> Vector2<f64> {
        let [columns, rows] = self.tags.map(|count| count as f64);
        Vector2::new(columns, rows) * (1.0 + self.spacing) - Vector2::repeat(self.spacing)
    }

    /// In sides from the lower left tag's corner.
    fn sides(&self, place: Place) -> Vector2<f64> {
        let off = Rotation2::new(-self.turn_rad) * (Vector2::from(place) - Vector2::from(self.middle));
        let off = if self.mirrored { Vector2::new(-off.x, off.y) } else { off };
        off / self.tag_m + self.size() / 2.0
    }

    /// The ink at a place of tag `id`, which counts from its lower left corner \[sides\].
    fn ink(id: usize, at: Vector2<f64>) -> bool {
        let cells = at * CELLS - Vector2::repeat(BORDER);
        let (column, from_below) = (cells.x.floor(), cells.y.floor());
        let side = CELLS - 2.0 * BORDER;
        if column < 0.0 || from_below < 0.0 || column >= side || from_below >= side {
            return true;
        }
        // The highest bit is the upper left cell's, the lowest the lower right one's; a set bit is white.
        let above_last = (from_below * side + (side - 1.0 - column)) as u32;
        CODES[id] >> above_last & 1 == 0
    }
}

impl Sheet for PlacedTags {
    fn paint(&self, place: Place) -> Option<f64> {
        let at = self.sides(place);
        let size = self.size();
        let within = |margin: f64| {
            at.x > -margin && at.y > -margin && at.x < size.x + margin && at.y < size.y + margin
        };
        if !within(self.spacing + 0.3) {
            return None;
        }
        if !within(self.spacing) {
            return Some(WHITE);
        }
        let pitch = 1.0 + self.spacing;
        // Which tag or gap: the gap before the first tag is that of column -1.
        let (column, row) = ((at.x / pitch).floor(), (at.y / pitch).floor());
        let inside = at - Vector2::new(column, row) * pitch;
        let on_tag = inside.map(|x| x < 1.0);
        let id = (on_tag.x && on_tag.y).then(|| row as usize * self.tags[0] + column as usize);
        let near = |id: usize| {
            let [x, y] = [(id % self.tags[0]) as f64 * pitch, (id / self.tags[0]) as f64 * pitch];
            let margin = self.spacing / 2.0;
            at.x > x - margin && at.y > y - margin && at.x < x + 1.0 + margin && at.y < y + 1.0 + margin
        };
        if self.hidden.iter().any(|&id| near(id)) {
            return Some(COVER);
        }
        let black = match id {
            Some(id) => Self::ink(id, inside),
            None => !on_tag.x && !on_tag.y,
        };
        Some(if black { BLACK } else { WHITE })
    }

    fn behind_m(&self) -> f64 {
        self.behind_m
    }

    fn corners(&self) -> Vec<Place> {
        let [columns, rows] = self.tags;
        let pitch = 1.0 + self.spacing;
        let place = |i: usize| {
            let (tag, corner) = (i / 4, i % 4);
            let at = Vector2::new((tag % columns) as f64, (tag / columns) as f64) * pitch
                + Vector2::new((corner % 2) as f64, (corner / 2) as f64);
            let off = (at - self.size() / 2.0) * self.tag_m;
            let off = if self.mirrored { Vector2::new(-off.x, off.y) } else { off };
            (Rotation2::new(self.turn_rad) * off + Vector2::from(self.middle)).into()
        };
        (0..4 * columns * rows).map(place).collect()
    }
}
