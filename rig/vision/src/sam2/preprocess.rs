//! From a picture to what the encoder takes, and from places in it to places there.

use image::GrayImage;

use super::array::Array;
use super::config::{Click, Crop};
use super::error::Sam2Error;

/// Sides of what the encoder takes \[px\].
pub(super) const SIDE: usize = 1024;
/// Mean and standard deviation of the pictures that the encoder was trained with: red, green, blue, from 0 to 1.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const STD: [f32; 3] = [0.229, 0.224, 0.225];

/// The part of the pictures that is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct View {
    pub(super) crop: Crop,
    /// Width and height of the whole pictures \[px\].
    pub(super) picture: [u32; 2],
}

/// Clicks as decoders take them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Prompt {
    /// Shape (1, clicks, 2), columns and rows of the encoder's picture \[px\].
    pub(super) coords: Array,
    /// Shape (1, clicks): 1 on the object, 0 beside it, -1 nothing.
    pub(super) labels: Array,
}

impl View {
    /// Of pictures of `size`, width and height \[px\]: `crop`, or the whole.
    pub(super) fn new(size: (u32, u32), crop: Option<Crop>) -> Result<Self, Sam2Error> {
        let (width, height) = size;
        let crop = crop.unwrap_or(Crop { left: 0, top: 0, width, height });
        let within = |from: u32, length: u32, whole: u32| u64::from(from) + u64::from(length) <= whole.into();
        let empty = crop.width == 0 || crop.height == 0;
        if empty || !within(crop.left, crop.width, width) || !within(crop.top, crop.height, height) {
            let Crop { left, top, width: w, height: h } = crop;
            let what = format!("crop_px, {w}x{h} px from column {left}, row {top},");
            return Err(Sam2Error::Outside { what, of: format!("the picture of {width}x{height} px") });
        }
        Ok(Self { crop, picture: [width, height] })
    }

    /// What the encoder takes, shape (1, 3, 1024, 1024): the part stretched to its sides, bilinear, the same grey in all colours.
    pub(super) fn pixels(&self, image: &GrayImage) -> Array {
        let columns = Samples::new(self.crop.left, self.crop.width);
        let rows = Samples::new(self.crop.top, self.crop.height);
        let width = image.width() as usize;
        let mut grey = Vec::with_capacity(SIDE * SIDE);
        for &(above, below, down) in &rows.0 {
            let row = |y: usize| &image.as_raw()[y * width..(y + 1) * width];
            let (above, below) = (row(above), row(below));
            grey.extend(columns.0.iter().map(|&(left, right, across)| {
                let between = |row: &[u8]| {
                    let (left, right) = (f32::from(row[left]), f32::from(row[right]));
                    left + across * (right - left)
                };
                let (above, below) = (between(above), between(below));
                (above + down * (below - above)) / 255.0
            }));
        }
        let colours = MEAN.iter().zip(STD);
        let values =
            colours.flat_map(|(mean, std)| grey.iter().map(move |grey| (grey - mean) / std)).collect();
        Array::new([1, 3, SIDE, SIDE], values)
    }

    /// The clicks, which must lie in the part.
    pub(super) fn prompt(&self, clicks: &[Click]) -> Result<Prompt, Sam2Error> {
        let Crop { left, top, width, height } = self.crop;
        let (mut coords, mut labels) = (Vec::new(), Vec::new());
        for click in clicks {
            let (x, y) = (click.x_px.get(), click.y_px.get());
            let within = |at: f64, from: u32, length: u32| {
                let at = at - f64::from(from);
                at >= -0.5 && at < f64::from(length) - 0.5
            };
            if !within(x, left, width) || !within(y, top, height) {
                let of = match self.crop
                    == (Crop { left: 0, top: 0, width: self.picture[0], height: self.picture[1] })
                {
                    true => format!("the picture of {width}x{height} px"),
                    false => format!("crop_px, {width}x{height} px from column {left}, row {top}"),
                };
                return Err(Sam2Error::Outside { what: format!("the click at column {x}, row {y}"), of });
            }
            let there = |at: f64, from: u32, length: u32| {
                ((at - f64::from(from)) * SIDE as f64 / f64::from(length)) as f32
            };
            coords.extend([there(x, left, width), there(y, top, height)]);
            labels.push(if click.positive { 1.0 } else { 0.0 });
        }
        Ok(Prompt::new(coords, labels))
    }

    /// Sides of one of `cells` cells across and down the part \[px\].
    pub(super) fn cell_px(&self, cells: usize) -> [f64; 2] {
        [self.crop.width, self.crop.height].map(|side| f64::from(side) / cells as f64)
    }
}

impl Prompt {
    /// Places, column and row each, and their labels.
    pub(super) fn new(coords: Vec<f32>, labels: Vec<f32>) -> Self {
        let clicks = labels.len();
        Self { coords: Array::new([1, clicks, 2], coords), labels: Array::new([1, clicks], labels) }
    }

    /// No click: one point that says nothing.
    pub(super) fn none() -> Self {
        Self::new(vec![0.0, 0.0], vec![-1.0])
    }
}

/// For each of the encoder's columns or rows, the two of the picture that it lies between and how far towards the second.
struct Samples(Vec<(usize, usize, f32)>);

impl Samples {
    /// Of `length` columns or rows of the picture beginning `from`.
    fn new(from: u32, length: u32) -> Self {
        let (from, length) = (from as usize, length as usize);
        let at = |i: usize| {
            let at = (i as f64 + 0.5) * length as f64 / SIDE as f64 - 0.5;
            let at = at.clamp(0.0, (length - 1) as f64);
            let before = at as usize;
            (from + before, from + (before + 1).min(length - 1), (at - before as f64) as f32)
        };
        Self((0..SIDE).map(at).collect())
    }
}

#[cfg(test)]
mod tests {
    use ground::strict::Finite;
    use image::Luma;

    use super::*;

    fn click(x: f64, y: f64, positive: bool) -> Click {
        Click { x_px: Finite::new(x).unwrap(), y_px: Finite::new(y).unwrap(), positive }
    }

    #[test]
    fn a_picture_of_the_encoders_size_is_only_normalised() {
        let side = SIDE as u32;
        let image = GrayImage::from_fn(side, side, |x, y| Luma([((3 * x + 5 * y) % 256) as u8]));
        let pixels = View::new((side, side), None).unwrap().pixels(&image);
        assert_eq!(pixels.shape, [1, 3, SIDE, SIDE]);
        for (colour, (mean, std)) in [(0.485, 0.229), (0.456, 0.224), (0.406, 0.225)].into_iter().enumerate()
        {
            for (x, y) in [(0, 0), (7, 900), (1023, 1023)] {
                let grey = f32::from(image.get_pixel(x as u32, y as u32)[0]);
                let got = pixels.values[(colour * SIDE + y) * SIDE + x];
                assert!((got - (grey / 255.0 - mean) / std).abs() < 1e-5, "{colour} {x} {y}");
            }
        }
    }

    #[test]
    fn a_slope_stays_one_when_it_is_stretched_and_the_crop_is_what_is_seen() {
        // Grey is the column: what lies at column x of the picture is x.
        let image = GrayImage::from_fn(200, 50, |x, _| Luma([x as u8]));
        let crop = Crop { left: 40, top: 10, width: 128, height: 32 };
        let pixels = View::new((200, 50), Some(crop)).unwrap().pixels(&image);
        for x in [4_usize, 100, 517, 1019] {
            let column = 40.0 + (x as f32 + 0.5) / 8.0 - 0.5;
            let got = (pixels.values[512 * SIDE + x] * 0.229 + 0.485) * 255.0;
            assert!((got - column).abs() < 1e-3, "{x}: {got} {column}");
        }
    }

    #[test]
    fn clicks_are_stretched_with_the_picture() {
        let view = View::new((640, 480), Some(Crop { left: 100, top: 20, width: 256, height: 128 })).unwrap();
        let prompt = view.prompt(&[click(100.0, 20.0, true), click(228.0, 84.0, false)]).unwrap();
        assert_eq!(prompt.coords, Array::new([1, 2, 2], vec![0.0, 0.0, 512.0, 512.0]));
        assert_eq!(prompt.labels, Array::new([1, 2], vec![1.0, 0.0]));
        assert_eq!(
            (Prompt::none().coords.values, Prompt::none().labels.values),
            (vec![0.0, 0.0], vec![-1.0])
        );
    }

    #[test]
    fn clicks_and_crops_outside_of_the_picture_are_refused() {
        let whole = View::new((640, 480), None).unwrap();
        for (x, y) in [(640.0, 10.0), (-1.0, 10.0), (10.0, 480.0)] {
            let told = whole.prompt(&[click(x, y, true)]).unwrap_err().to_string();
            assert!(told.contains("640x480") && told.contains(&format!("column {x}, row {y}")), "{told}");
        }
        let crop = Crop { left: 600, top: 0, width: 41, height: 10 };
        assert!(View::new((640, 480), Some(crop)).is_err());
        let crop = Crop { width: u32::MAX, ..crop };
        assert!(View::new((640, 480), Some(crop)).is_err());
        assert!(View::new((0, 0), None).is_err());
    }
}
