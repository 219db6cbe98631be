//! SAM 2 as exported for single images: two graphs, no memory. Each image is asked for what was found in the one before: its mask as
//! the decoder's own answer, and a place well inside it in the stead of a click.

use ort::environment::Environment;

use super::array::Array;
use super::error::Sam2Error;
use super::files::ImageFiles;
use super::graph::{Feed, Graph};
use super::logits::Logits;
use super::preprocess::Prompt;
use super::signature::{F32, I64, Signature, optional, wanted};
use super::{CELLS, Follower};

const EMBED: &str = "image_embed";
const FINE: [&str; 2] = ["high_res_feats_0", "high_res_feats_1"];

static ENCODER: Signature = Signature {
    inputs: &[wanted(&["image"], &[F32], &[&[1, 3, 1024, 1024]])],
    outputs: &[
        wanted(&[FINE[0]], &[F32], &[&[1, 32, 256, 256]]),
        wanted(&[FINE[1]], &[F32], &[&[1, 64, 128, 128]]),
        wanted(&[EMBED], &[F32], &[&[1, 256, 64, 64]]),
    ],
};

static DECODER: Signature = Signature {
    inputs: &[
        wanted(&[EMBED], &[F32], &[&[1, 256, 64, 64]]),
        wanted(&[FINE[0]], &[F32], &[&[1, 32, 256, 256]]),
        wanted(&[FINE[1]], &[F32], &[&[1, 64, 128, 128]]),
        wanted(&["point_coords"], &[F32], &[&[-1, -1, 2]]),
        wanted(&["point_labels"], &[F32], &[&[-1, -1]]),
        wanted(&["mask_input"], &[F32], &[&[-1, 1, 256, 256]]),
        wanted(&["has_mask_input"], &[F32], &[&[-1]]),
        // Older exports.
        optional(&["orig_im_size"], &[I64, F32], &[&[2]]),
    ],
    outputs: &[
        wanted(&["masks"], &[F32], &[&[-1, -1, -1, -1]]),
        wanted(&["iou_predictions"], &[F32], &[&[-1, -1]]),
    ],
};

/// Clicks beside the mechanism are given again while it is at least so many cells away from them.
const AWAY_CELLS: f32 = 8.0;

/// The two graphs and what was found last.
#[derive(Debug)]
pub(super) struct Single {
    encoder: Graph,
    decoder: Graph,
    prompt: Option<Prompt>,
    clicked: Option<Logits>,
    last: Option<Logits>,
}

impl Single {
    /// Reads the graphs, to be run on so many threads.
    pub(super) fn read(runtime: &Environment, files: &ImageFiles, threads: usize) -> Result<Self, Sam2Error> {
        let read = |path, signature| Graph::read(runtime, path, signature, threads);
        Ok(Self {
            encoder: read(&files.encoder, &ENCODER)?,
            decoder: read(&files.decoder, &DECODER)?,
            prompt: None,
            clicked: None,
            last: None,
        })
    }

    /// The most certain of the decoder's answers.
    fn answer(
        &mut self,
        pixels: &Array,
        prompt: &Prompt,
        before: Option<&Logits>,
    ) -> Result<Logits, Sam2Error> {
        let [fine0, fine1, embed] =
            self.encoder.run(&[("image", Feed::Numbers(pixels))], [FINE[0], FINE[1], EMBED])?;
        let mask = before.filter(|before| (before.width, before.height) == (CELLS, CELLS));
        let has_mask = Array::one(if mask.is_some() { 1.0 } else { 0.0 });
        let values = mask.map_or_else(|| vec![0.0; CELLS * CELLS], |mask| mask.values.clone());
        let mask = Array::new([1, 1, CELLS, CELLS], values);
        let feeds = [
            (EMBED, Feed::Numbers(&embed)),
            (FINE[0], Feed::Numbers(&fine0)),
            (FINE[1], Feed::Numbers(&fine1)),
            ("point_coords", Feed::Numbers(&prompt.coords)),
            ("point_labels", Feed::Numbers(&prompt.labels)),
            ("mask_input", Feed::Numbers(&mask)),
            ("has_mask_input", Feed::Numbers(&has_mask)),
            ("orig_im_size", Feed::Size([CELLS; 2])),
        ];
        let [masks, certain] = self.decoder.run(&feeds, ["masks", "iou_predictions"])?;
        let best = certain.values.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(i, _)| i);
        Ok(Logits::of(&masks, best))
    }
}

/// What is asked for where `last` was found before, with those of the clicks `first` beside the mechanism that it is not near to.
fn asked_again(first: &Prompt, last: &Logits) -> Option<Prompt> {
    let inside = last.inside()?;
    let (mut coords, mut labels) = (inside.to_vec(), vec![1.0]);
    for (at, label) in first.coords.values.chunks_exact(2).zip(&first.labels.values) {
        if *label == 0.0 && !last.near([at[0], at[1]], AWAY_CELLS) {
            coords.extend_from_slice(at);
            labels.push(0.0);
        }
    }
    Some(Prompt::new(coords, labels))
}

impl Follower for Single {
    fn clicked(&mut self, _: usize, pixels: &Array, prompt: &Prompt) -> Result<Logits, Sam2Error> {
        let found = self.answer(pixels, prompt, None)?;
        self.prompt = Some(prompt.clone());
        self.clicked = Some(found.clone());
        self.last = Some(found.clone());
        Ok(found)
    }

    fn followed(&mut self, _: usize, pixels: &Array) -> Result<Logits, Sam2Error> {
        let last = self.last.take();
        let prompt =
            self.prompt.as_ref().zip(last.as_ref()).and_then(|(first, last)| asked_again(first, last));
        let found = self.answer(pixels, &prompt.unwrap_or_else(Prompt::none), last.as_ref())?;
        // Where nothing is found, the next image is asked for what was there before.
        self.last = if found.inside().is_some() { Some(found.clone()) } else { last };
        Ok(found)
    }

    fn rewind(&mut self) {
        self.last.clone_from(&self.clicked);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clicks_beside_the_mechanism_are_left_out_while_it_is_there() {
        let square = |from: usize| {
            let inside =
                |i: usize| (from..from + 20).contains(&(i % CELLS)) && (100..120).contains(&(i / CELLS));
            let values = (0..CELLS * CELLS).map(|i| if inside(i) { 1.0 } else { -1.0 }).collect();
            Logits { width: CELLS, height: CELLS, values }
        };
        let first = Prompt::new(vec![40.0, 440.0, 500.0, 440.0], vec![1.0, 0.0]);
        let far = asked_again(&first, &square(0)).unwrap();
        assert_eq!(far.labels.values, [1.0, 0.0]);
        assert_eq!(far.coords.values[2..], [500.0, 440.0]);
        let near = asked_again(&first, &square(102)).unwrap();
        assert_eq!(near.labels.values, [1.0]);
        assert!((408.0..488.0).contains(&near.coords.values[0]), "{:?}", near.coords);
        assert!(asked_again(&first, &Logits { values: vec![-1.0; CELLS * CELLS], ..square(0) }).is_none());
    }
}
