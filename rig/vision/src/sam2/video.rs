//! SAM 2 as exported for films: four graphs, with a memory.

use ort::environment::Environment;

use super::array::Array;
use super::error::Sam2Error;
use super::files::VideoFiles;
use super::graph::{Feed, Graph};
use super::logits::Logits;
use super::memory::{Memories, Memory, Recalled};
use super::preprocess::Prompt;
use super::signature::{F32, I64, Signature, optional, wanted};
use super::{CELLS, Follower};

const PIX_FEAT: &str = "pix_feat";
const VISION_FEATS: &str = "vision_feats";
const POSITIONS: &str = "vision_pos_embed";
const EMBED: &str = "image_embed";
const OFFSETS: &str = "obj_ptr_offsets";
const AGE: &str = "temporal_code";

/// Both name sets of public exports.
static IMAGE_ENCODER: Signature = Signature {
    inputs: &[wanted(&["image", "input"], &[F32], &[&[1, 3, 1024, 1024]])],
    outputs: &[
        wanted(&[PIX_FEAT, "image_embeddings"], &[F32], &[&[1, 256, 64, 64]]),
        wanted(&["high_res_feat0", "high_res_features1"], &[F32], &[&[1, 32, 256, 256]]),
        wanted(&["high_res_feat1", "high_res_features2"], &[F32], &[&[1, 64, 128, 128]]),
        wanted(&[VISION_FEATS, "current_vision_feat"], &[F32], &[&[1, 256, 64, 64]]),
        wanted(&[POSITIONS], &[F32], &[&[4096, 1, 256]]),
    ],
};

static IMAGE_DECODER: Signature = Signature {
    inputs: &[
        wanted(&["point_coords"], &[F32], &[&[-1, -1, 2]]),
        wanted(&["point_labels"], &[F32], &[&[-1, -1]]),
        optional(&["frame_size"], &[I64, F32], &[&[2]]),
        wanted(&[EMBED], &[F32], &[&[1, 256, 64, 64]]),
        wanted(&["high_res_feats_0"], &[F32], &[&[1, 32, 256, 256]]),
        wanted(&["high_res_feats_1"], &[F32], &[&[1, 64, 128, 128]]),
    ],
    outputs: &[
        wanted(&["obj_ptr"], &[F32], &[&[1, 256]]),
        wanted(&["mask_for_mem"], &[F32], &[&[1, 1, 1024, 1024]]),
        wanted(&["pred_mask"], &[F32], &[&[1, 1, -1, -1]]),
    ],
};

static MEMORY_ENCODER: Signature = Signature {
    inputs: &[
        wanted(&["mask_for_mem"], &[F32], &[&[1, 1, 1024, 1024]]),
        wanted(&[PIX_FEAT], &[F32], &[&[1, 256, 64, 64]]),
    ],
    outputs: &[
        wanted(&["maskmem_features"], &[F32], &[&[1, 64, 64, 64]]),
        wanted(&["maskmem_pos_enc"], &[F32], &[&[4096, 1, 64]]),
        optional(&[AGE], &[F32], &[&[7, 1, 1, 64], &[7, 1, 64], &[7, 64]]),
    ],
};

static MEMORY_ATTENTION: Signature = Signature {
    inputs: &[
        wanted(&["current_vision_feat"], &[F32], &[&[1, 256, 64, 64]]),
        wanted(&["current_vision_pos_embed"], &[F32], &[&[4096, 1, 256]]),
        wanted(&["memory_0"], &[F32], &[&[-1, 256]]),
        wanted(&["memory_1"], &[F32], &[&[-1, 64, 64, 64]]),
        wanted(&["memory_pos_embed"], &[F32], &[&[-1, 1, 64]]),
        optional(&[OFFSETS], &[F32], &[&[-1]]),
    ],
    outputs: &[wanted(&[EMBED, "fused_feat"], &[F32], &[&[1, 256, 64, 64]])],
};

/// The mask that goes into the memory is this far above or below 0 where it is certain.
const CERTAIN: f32 = 10.0;

/// The four graphs and what they remember.
#[derive(Debug)]
pub(super) struct Video {
    image_encoder: Graph,
    image_decoder: Graph,
    memory_encoder: Graph,
    memory_attention: Graph,
    memories: Memories,
}

/// An image as the encoder gives it.
struct Encoded {
    raw: Array,
    fine: [Array; 2],
    feats: Array,
    positions: Array,
}

impl Video {
    /// Reads the graphs, to be run on so many threads.
    pub(super) fn read(runtime: &Environment, files: &VideoFiles, threads: usize) -> Result<Self, Sam2Error> {
        let read = |path, signature| Graph::read(runtime, path, signature, threads);
        Ok(Self {
            image_encoder: read(&files.image_encoder, &IMAGE_ENCODER)?,
            image_decoder: read(&files.image_decoder, &IMAGE_DECODER)?,
            memory_encoder: read(&files.memory_encoder, &MEMORY_ENCODER)?,
            memory_attention: read(&files.memory_attention, &MEMORY_ATTENTION)?,
            memories: Memories::default(),
        })
    }

    fn encoded(&mut self, pixels: &Array) -> Result<Encoded, Sam2Error> {
        let keys = [PIX_FEAT, "high_res_feat0", "high_res_feat1", VISION_FEATS, POSITIONS];
        let [raw, fine0, fine1, feats, positions] =
            self.image_encoder.run(&[("image", Feed::Numbers(pixels))], keys)?;
        Ok(Encoded { raw, fine: [fine0, fine1], feats, positions })
    }

    /// The decoder's mask for the memory, its pointer, and its answer.
    fn decoded(
        &mut self,
        embed: &Array,
        fine: &[Array; 2],
        prompt: &Prompt,
    ) -> Result<(Array, Array, Logits), Sam2Error> {
        let feeds = [
            ("point_coords", Feed::Numbers(&prompt.coords)),
            ("point_labels", Feed::Numbers(&prompt.labels)),
            ("frame_size", Feed::Size([CELLS; 2])),
            (EMBED, Feed::Numbers(embed)),
            ("high_res_feats_0", Feed::Numbers(&fine[0])),
            ("high_res_feats_1", Feed::Numbers(&fine[1])),
        ];
        let keys = ["mask_for_mem", "obj_ptr", "pred_mask"];
        let [mask, pointer, answer] = self.image_decoder.run(&feeds, keys)?;
        Ok((mask, pointer, Logits::of(&answer, 0)))
    }

    /// What is remembered of an image: its raw features, whatever the decoder was given.
    fn memory(
        &mut self,
        image: usize,
        raw: &Array,
        mask: &Array,
        pointer: Array,
    ) -> Result<Memory, Sam2Error> {
        let feeds = [("mask_for_mem", Feed::Numbers(mask)), (PIX_FEAT, Feed::Numbers(raw))];
        let [features, position] =
            self.memory_encoder.run(&feeds, ["maskmem_features", "maskmem_pos_enc"])?;
        Ok(Memory { image, features, position, pointer })
    }

    /// The code of age, which is the same for all images.
    fn age(&mut self, raw: &Array, mask: &Array) -> Result<Option<Array>, Sam2Error> {
        if !self.memory_encoder.gives(AGE) {
            return Ok(None);
        }
        let feeds = [("mask_for_mem", Feed::Numbers(mask)), (PIX_FEAT, Feed::Numbers(raw))];
        let [age] = self.memory_encoder.run(&feeds, [AGE])?;
        Ok(Some(age))
    }
}

impl Follower for Video {
    fn clicked(&mut self, image: usize, pixels: &Array, prompt: &Prompt) -> Result<Logits, Sam2Error> {
        let Encoded { raw, fine, feats, .. } = self.encoded(pixels)?;
        let (mut mask, pointer, answer) = self.decoded(&feats, &fine, prompt)?;
        // What was clicked is certain.
        mask.values.iter_mut().for_each(|value| *value = if *value > 0.0 { CERTAIN } else { -CERTAIN });
        let memory = self.memory(image, &raw, &mask, pointer)?;
        let age = self.age(&raw, &mask)?;
        self.memories = Memories::of_clicked(memory, age);
        Ok(answer)
    }

    fn followed(&mut self, image: usize, pixels: &Array) -> Result<Logits, Sam2Error> {
        let Encoded { raw, fine, feats, positions } = self.encoded(pixels)?;
        let offsets_within = self.memory_attention.takes(OFFSETS);
        let Recalled { pointers, offsets, features, positions: places } =
            self.memories.recalled(image, !offsets_within);
        let feeds = [
            ("current_vision_feat", Feed::Numbers(&feats)),
            ("current_vision_pos_embed", Feed::Numbers(&positions)),
            ("memory_0", Feed::Numbers(&pointers)),
            ("memory_1", Feed::Numbers(&features)),
            ("memory_pos_embed", Feed::Numbers(&places)),
            (OFFSETS, Feed::Numbers(&offsets)),
        ];
        let [embed] = self.memory_attention.run(&feeds, [EMBED])?;
        let (mask, pointer, answer) = self.decoded(&embed, &fine, &Prompt::none())?;
        let memory = self.memory(image, &raw, &mask, pointer)?;
        self.memories.take(memory);
        Ok(answer)
    }

    fn rewind(&mut self) {
        self.memories.rewind();
    }
}
