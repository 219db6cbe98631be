//! The pose of the model that explains a picture: for mechanisms that are held, move in the plane and have a model.
//!
//! Nothing is segmented. `mechanism` puts the model's solids into the plane for a pose and says where their outline is; `view` where
//! the camera shows it; `lines` reads the picture across the outline only, and says what each place of the edge would cost there;
//! `edge` is what an edge looks like there; `tables` and `solve` find the pose of least cost. `tank` and the mechanism's colours are learned from what fitted poses leave clear, `search`
//! finds first poses at low resolution, `rims` learns how edges look that light falls on from one side. `film` takes a film's images through all of them: what all images share (P0, widths, depth) is
//! found from all of a sample together (`shared`), an image's pose from its own picture. `sigma` says how far off they may be.

mod colours;
mod edge;
mod film;
mod lines;
mod mechanism;
mod place;
mod rims;
mod search;
mod shared;
mod sigma;
mod solve;
mod tables;
mod tank;
mod view;

pub use film::{Given, PoseFilm};
pub use mechanism::Mechanism;
