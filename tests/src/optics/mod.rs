//! Films of mechanisms under water by ray tracing, with exact truth: a camera in air before a flat port, solids with depth, light from
//! above, a tank with walls, and what else is before, behind and between. Shares no code with what reads films or with the mock camera.
//!
//! `camera`: the port, the lens and rays; `solids`, `mechanism`, `octopus`, `model`: what moves and its model; `light`,
//! `tank`, `texture`, `tiles`, `glass`, `actors`: what is seen with it; `scenes`: what makes a film hard, `scene` lists them;
//! `render` and `sensor`: from rays to a compressed picture; `truth`: where keypoints are seen; `film`: a folder that
//! `rig extract` reads; [`score`]: what an extraction made of one.

mod actors;
mod calibrate;
mod camera;
mod film;
mod glass;
mod light;
mod mechanism;
mod model;
mod motion;
mod octopus;
mod picture;
mod render;
mod scene;
mod scenes;
pub mod score;
mod sensor;
mod setting;
mod solids;
mod tank;
#[cfg(test)]
mod tests;
mod texture;
mod tiles;
mod truth;
mod vec;
mod world;

use std::path::Path;

use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

pub use mechanism::Kind;
use setting::Setting;

/// A film to be rendered.
#[derive(Debug, Clone)]
pub struct Film {
    /// What moves.
    pub kind: Kind,
    /// What makes it hard: names of scenes, joined by `+`.
    pub scene: String,
    /// Everything about it is drawn from this.
    pub seed: u64,
    /// Number of images, 50 a second.
    pub images: usize,
    /// Width and height, even \[px\].
    pub size_px: (usize, usize),
}

impl Film {
    /// Renders it into `folder`: frames/, extract.toml, tank.toml, model.xml, truth.csv; with `empty`, also a picture of the empty tank.
    ///
    /// # Errors
    /// A scene that there is not, or a folder that cannot be written, as a message.
    pub fn write(&self, folder: &Path, empty: bool) -> Result<(), String> {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let mut setting = Setting::drawn(self.kind, self.seed, self.images, self.size_px, &mut random);
        scene::apply(&self.scene, &mut setting, &mut random)?;
        setting.finish(&mut random);
        film::write(&setting, folder, empty, &self.name(), &mut random)
    }

    /// Kind, scene and seed.
    pub fn name(&self) -> String {
        format!("{:?} {} {}", self.kind, self.scene, self.seed).to_lowercase()
    }
}
