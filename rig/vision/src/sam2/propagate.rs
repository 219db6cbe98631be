//! From the clicked image to the film's end, then back to its beginning.

use std::time::{Duration, Instant};

use ground::strict::Positive;
use image::GrayImage;

use super::config::Sam2Config;
use super::error::Sam2Error;
use super::logits::{LARGEST_HOLE, Logits};
use super::preprocess::View;
use super::{CELLS, Follower};
use crate::silhouettes::Silhouettes;
use crate::{Mask, SequenceError, VisionError};
use camera::source::{ImageSource, TimedImage};

/// Images before the clicked one that are held at once: a film is read forwards only.
const HELD: usize = 64;
/// A mechanism fills no more than this share of what is looked at.
const MOST_SHARE: f64 = 0.5;
/// An answer's edges are off by no more than so many cells (guessed).
const BLUR_CELLS: f64 = 2.0;
/// How often it is said how far it is.
const SAID_EVERY: Duration = Duration::from_secs(30);

/// What `follower` finds in all images of `source`.
pub(super) fn silhouettes(
    follower: &mut dyn Follower,
    config: &Sam2Config,
    source: &(impl ImageSource + ?Sized),
) -> Result<Silhouettes, SequenceError> {
    let start = config.start_image;
    let mut images = source.images()?.enumerate();
    let mut seen = 0;
    let clicked = loop {
        match images.next() {
            Some((number, image)) if number == start => break image?,
            Some((_, image)) => image.map(|_| seen += 1)?,
            None => return Err(refused(Sam2Error::NoStart { start_image: start, images: seen })),
        }
    };
    let name = || clicked.name.clone();
    let unreadable =
        |why: &String| Sam2Error::UnreadableStart { start_image: start, name: name(), why: why.clone() };
    let grey = clicked.grey.as_ref().map_err(unreadable).map_err(refused)?;
    let view = View::new(grey.dimensions(), config.crop_px).map_err(refused)?;
    let prompt = view.prompt(&config.clicks).map_err(refused)?;
    let answer = follower.clicked(start, &view.pixels(grey), &prompt).map_err(refused)?;
    let silhouette = silhouette(answer, &view);
    let share = silhouette.area() as f64 / (f64::from(view.crop.width) * f64::from(view.crop.height));
    if silhouette.area() == 0 {
        return Err(refused(Sam2Error::Nothing { start_image: start, name: name() }));
    }
    if share > MOST_SHARE {
        return Err(refused(Sam2Error::Background { start_image: start, name: name(), share }));
    }
    let [across, down] = view.cell_px(CELLS);
    let blur_px = config.edge_px.map_or(BLUR_CELLS * across.max(down), Positive::get);
    let mut film = Film { follower, view, found: Silhouettes::new(blur_px), said: Instant::now() };
    film.found.put(clicked.time_s, silhouette);
    for (number, image) in images {
        film.follow(number, &image?)?;
    }
    film.follower.rewind();
    let mut end = start;
    while end > 0 {
        let begin = end.saturating_sub(HELD);
        let held: Vec<TimedImage> =
            source.images()?.skip(begin).take(end - begin).collect::<Result<_, _>>()?;
        for (number, image) in (begin..end).zip(&held).rev() {
            film.follow(number, image)?;
        }
        end = begin;
    }
    Ok(film.found)
}

/// A film under way.
struct Film<'a> {
    follower: &'a mut dyn Follower,
    view: View,
    found: Silhouettes,
    said: Instant,
}

impl Film<'_> {
    /// The next image, or the one before; one that cannot be read is left out, and one of another size.
    fn follow(&mut self, number: usize, image: &TimedImage) -> Result<(), SequenceError> {
        let fits = |grey: &&GrayImage| <[u32; 2]>::from(grey.dimensions()) == self.view.picture;
        if let Some(grey) = image.grey.as_ref().ok().filter(fits) {
            let answer = self.follower.followed(number, &self.view.pixels(grey)).map_err(refused)?;
            self.found.put(image.time_s, silhouette(answer, &self.view));
        }
        if self.said.elapsed() > SAID_EVERY {
            tracing::info!("SAM 2: {} images so far, now number {number}", self.found.count());
            self.said = Instant::now();
        }
        Ok(())
    }
}

fn silhouette(mut answer: Logits, view: &View) -> Mask {
    answer.fill_holes(LARGEST_HOLE);
    answer.mask(view)
}

fn refused(error: Sam2Error) -> SequenceError {
    SequenceError::Vision(VisionError::Sam2(error))
}

#[cfg(test)]
mod tests {
    use ground::strict::Finite;
    use image::Luma;

    use super::super::array::Array;
    use super::super::config::Click;
    use super::super::preprocess::{Prompt, SIDE};
    use super::*;

    /// Finds whatever is dark, and keeps the order in which it was asked.
    #[derive(Default)]
    struct Dark {
        asked: Vec<String>,
    }

    impl Dark {
        fn find(pixels: &Array) -> Logits {
            let step = SIDE / CELLS;
            let at = |i: usize| pixels.values[(i / CELLS * step + 1) * SIDE + i % CELLS * step + 1];
            Logits { width: CELLS, height: CELLS, values: (0..CELLS * CELLS).map(|i| -at(i)).collect() }
        }
    }

    impl Follower for Dark {
        fn clicked(&mut self, image: usize, pixels: &Array, _: &Prompt) -> Result<Logits, Sam2Error> {
            self.asked.push(format!("clicked {image}"));
            Ok(Self::find(pixels))
        }

        fn followed(&mut self, image: usize, pixels: &Array) -> Result<Logits, Sam2Error> {
            self.asked.push(image.to_string());
            Ok(Self::find(pixels))
        }

        fn rewind(&mut self) {
            self.asked.push("rewind".into());
        }
    }

    /// Image n, 256 px a side: a dark square at column 10 n.
    fn film(images: usize) -> Vec<TimedImage> {
        let grey = |n: usize| {
            GrayImage::from_fn(256, 256, |x, y| {
                let dark = (10 * n as u32..10 * n as u32 + 20).contains(&x) && (100..120).contains(&y);
                Luma([if dark { 20 } else { 220 }])
            })
        };
        (0..images)
            .map(|n| TimedImage {
                name: format!("{n}"),
                time_s: n as f64 / 7.0,
                chroma: None,
                grey: Ok(grey(n)),
            })
            .collect()
    }

    fn clicks(start_image: usize, x: f64, y: f64) -> Sam2Config {
        let click = Click { x_px: Finite::new(x).unwrap(), y_px: Finite::new(y).unwrap(), positive: true };
        Sam2Config {
            weights: "w".into(),
            library: None,
            start_image,
            clicks: vec![click],
            crop_px: None,
            edge_px: None,
            threads: None,
        }
    }

    #[test]
    fn a_film_is_gone_through_forwards_then_backwards_from_the_click() {
        let mut film = film(6);
        film[1].grey = Err("damaged".into());
        film[4].grey = Ok(GrayImage::new(100, 100));
        let mut dark = Dark::default();
        let found = silhouettes(&mut dark, &clicks(2, 30.0, 110.0), film.as_slice()).unwrap();
        assert_eq!(dark.asked, ["clicked 2", "3", "5", "rewind", "0"]);
        for (n, image) in film.iter().enumerate() {
            let centre = found.of(image.time_s).and_then(Mask::centroid);
            match n {
                1 | 4 => assert_eq!(centre, None),
                _ => assert_eq!(centre.unwrap(), [10.0 * n as f64 + 9.5, 109.5]),
            }
        }
    }

    #[test]
    fn images_before_the_click_are_read_in_portions_and_none_is_missed() {
        let long: Vec<TimedImage> =
            (0..150).map(|n| TimedImage { time_s: f64::from(n), ..film(1)[0].clone() }).collect();
        let mut dark = Dark::default();
        let found = silhouettes(&mut dark, &clicks(140, 5.0, 110.0), long.as_slice()).unwrap();
        assert_eq!(found.count(), 150);
        let backwards: Vec<String> = (0..140).rev().map(|n| n.to_string()).collect();
        assert_eq!(dark.asked[dark.asked.len() - 140..], backwards);
    }

    #[test]
    fn clicks_that_select_nothing_everything_or_no_image_are_refused() {
        let film = film(3);
        let told = |start: usize, film: &[TimedImage]| {
            let refused = silhouettes(&mut Dark::default(), &clicks(start, 5.0, 110.0), film);
            refused.expect_err("refused").to_string()
        };
        let error = |start, film: &[TimedImage]| {
            let refused = silhouettes(&mut Dark::default(), &clicks(start, 5.0, 110.0), film);
            match refused.expect_err("refused") {
                SequenceError::Vision(VisionError::Sam2(error)) => error,
                other => panic!("{other}"),
            }
        };
        assert!(matches!(error(3, &film), Sam2Error::NoStart { start_image: 3, images: 3 }));
        let of = |grey: Result<GrayImage, String>| vec![TimedImage { grey, ..film[0].clone() }];
        let light = of(Ok(GrayImage::from_pixel(256, 256, Luma([220]))));
        assert!(matches!(error(0, &light), Sam2Error::Nothing { .. }));
        let dark = of(Ok(GrayImage::new(256, 256)));
        assert!(matches!(error(0, &dark), Sam2Error::Background { share, .. } if share > 0.99));
        assert!(matches!(error(0, &of(Err("torn".into()))), Sam2Error::UnreadableStart { .. }));
        assert!(!told(3, &film).is_empty());
    }
}
