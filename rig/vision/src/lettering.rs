//! Words in pictures.

use image::{Rgb, RgbImage};
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, RasterizedChar, get_raster, get_raster_width};

/// How large letters are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Size {
    /// 16 px a line.
    Small,
    /// 24 px a line.
    Large,
}

const WEIGHT: FontWeight = FontWeight::Regular;
/// What stands for a letter that the font lacks.
const UNKNOWN: char = '?';

impl Size {
    fn raster(self) -> RasterHeight {
        match self {
            Self::Small => RasterHeight::Size16,
            Self::Large => RasterHeight::Size24,
        }
    }

    /// Height of a line \[px\].
    pub fn line_px(self) -> u32 {
        self.raster().val() as u32
    }

    /// Width of a letter, all of which are equally wide \[px\].
    pub fn letter_px(self) -> u32 {
        get_raster_width(WEIGHT, self.raster()) as u32
    }

    fn letter(self, letter: char) -> Option<RasterizedChar> {
        get_raster(letter, WEIGHT, self.raster()).or_else(|| get_raster(UNKNOWN, WEIGHT, self.raster()))
    }
}

/// Writes `text` in one line with its top left corner at `(column, row)`; what lies outside the picture is cut.
pub fn write(picture: &mut RgbImage, (column, row): (u32, u32), text: &str, size: Size, ink: Rgb<u8>) {
    let mut left = column;
    for letter in text.chars() {
        let Some(raster) = size.letter(letter) else { continue };
        for (cover, dy) in raster.rows().zip(0..) {
            for (&cover, dx) in cover.iter().zip(0..) {
                let (x, y) = (left.saturating_add(dx), row.saturating_add(dy));
                if let Some(pixel) = picture.get_pixel_mut_checked(x, y) {
                    for (channel, ink) in pixel.0.iter_mut().zip(ink.0) {
                        let mixed =
                            u32::from(*channel) * u32::from(255 - cover) + u32::from(ink) * u32::from(cover);
                        *channel = (mixed / 255) as u8;
                    }
                }
            }
        }
        left = left.saturating_add(size.letter_px());
    }
}

/// `text` in lines of at most `letters` letters, broken between words where that can be done, at most `most` of them: a last line
/// that leaves something out ends in `..`.
pub fn wrapped(text: &str, letters: usize, most: usize) -> Vec<String> {
    let letters = letters.max(2);
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let mut word: Vec<char> = word.chars().collect();
        if let Some(line) = lines.last_mut()
            && line.chars().count() + 1 + word.len() <= letters
        {
            line.push(' ');
            line.extend(word);
            continue;
        }
        while word.len() > letters {
            lines.push(word.drain(..letters).collect());
        }
        lines.push(word.into_iter().collect());
    }
    if lines.len() > most {
        lines.truncate(most);
        if let Some(last) = lines.last_mut() {
            *last = last.chars().take(letters - 2).chain("..".chars()).collect();
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLACK: Rgb<u8> = Rgb([0; 3]);
    const WHITE: Rgb<u8> = Rgb([255; 3]);

    #[test]
    fn letters_are_written_in_their_cells_only_and_cut_at_the_border() {
        let mut picture = RgbImage::from_pixel(60, 40, WHITE);
        write(&mut picture, (10, 12), "H", Size::Small, BLACK);
        let inked: Vec<(u32, u32)> =
            picture.enumerate_pixels().filter(|(.., p)| **p != WHITE).map(|(x, y, _)| (x, y)).collect();
        assert!(inked.len() > 10);
        let within = |&(x, y): &(u32, u32)| {
            (10..10 + Size::Small.letter_px()).contains(&x) && (12..12 + Size::Small.line_px()).contains(&y)
        };
        assert!(inked.iter().all(within));

        let mut unknown = RgbImage::from_pixel(60, 40, WHITE);
        write(&mut unknown, (10, 12), "\u{4e00}", Size::Small, BLACK);
        let mut asked = RgbImage::from_pixel(60, 40, WHITE);
        write(&mut asked, (10, 12), "?", Size::Small, BLACK);
        assert_eq!(unknown, asked);
        write(&mut picture, (55, 39), "a long line at the corner", Size::Large, BLACK);
        write(&mut picture, (u32::MAX - 3, u32::MAX - 3), "nowhere", Size::Large, BLACK);
    }

    #[test]
    fn text_is_broken_between_words_and_what_is_left_out_shows() {
        assert_eq!(wrapped("no silhouette was stored", 13, 9), ["no silhouette", "was stored"]);
        assert_eq!(wrapped("incomprehensible", 7, 9), ["incompr", "ehensib", "le"]);
        assert_eq!(wrapped("one two three four", 7, 2), ["one two", "three.."]);
        assert_eq!(wrapped("one two three four", 7, 3), ["one two", "three", "four"]);
        assert_eq!(wrapped("", 9, 2), Vec::<String>::new());
    }
}
