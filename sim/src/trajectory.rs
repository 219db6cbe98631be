//! Keypoint positions over time: the type that measured and simulated motion share.

/// N instants by K keypoints in the tank frame (x right, y away from the camera, z up).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trajectory {
    /// Instants \[s\], shape (N), strictly rising, not necessarily even.
    pub time_s: Vec<f64>,
    /// Keypoint names, shape (K).
    pub keypoints: Vec<String>,
    /// Positions \[m\], row-major, shape (N, K), each `[x, y, z]`. NaN: a gap, or an axis never observed.
    pub position_m: Vec<[f64; 3]>,
    /// Standard deviation of each position \[m\], shape (N, K), where the source states one.
    pub std_m: Option<Vec<f64>>,
    /// The part of that deviation \[m\] that follows the pose, shape (N, K), where the source tells it apart: it stays while the
    /// mechanism rests and comes back with the pose, so no average over images takes it out.
    pub pose_std_m: Option<Vec<f64>>,
}

impl Trajectory {
    /// Position of keypoint `keypoint` at instant `instant` \[m\].
    pub fn at(&self, instant: usize, keypoint: usize) -> [f64; 3] {
        self.position_m[instant * self.keypoints.len() + keypoint]
    }

    /// Adds a keypoint or another mark, with its `position_m` at each instant, shape (N); no deviations are known of it.
    ///
    /// # Panics
    /// When there are more or fewer positions than instants.
    pub fn add_mark(&mut self, name: String, position_m: &[[f64; 3]]) {
        assert_eq!(position_m.len(), self.time_s.len(), "a position for each instant");
        let width = self.keypoints.len();
        self.position_m = beside(&self.position_m, width, position_m);
        let unknown = vec![f64::NAN; position_m.len()];
        for stds_m in [&mut self.std_m, &mut self.pose_std_m].into_iter().flatten() {
            *stds_m = beside(stds_m, width, &unknown);
        }
        self.keypoints.push(name);
    }
}

/// A table of `width` columns, row after row, with another column.
fn beside<T: Copy>(table: &[T], width: usize, column: &[T]) -> Vec<T> {
    let rows = column.iter().enumerate();
    rows.flat_map(|(row, last)| table[row * width..(row + 1) * width].iter().chain([last])).copied().collect()
}
