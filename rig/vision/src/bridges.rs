//! What lies between two seen parts of the mechanism, across something still that is as dark, is the mechanism as well.

use super::Mask;

/// Pixels of something still, and where a straight way over each leaves it on either side.
#[derive(Debug, Clone, Default)]
pub(super) struct Bridges(Vec<[u32; 3]>);

/// Straight ways are no longer than this share of the picture's diagonal.
const MOST_SHARE: f64 = 0.04;

impl Bridges {
    /// Over `still`, a mask of the whole picture.
    pub(super) fn over(still: &Mask) -> Self {
        let (width, height) = (still.width as isize, still.height as isize);
        let most = (MOST_SHARE * (width as f64).hypot(height as f64)) as isize;
        // Steps from a pixel out of what is still; none at the border or where it is too far.
        let out = |(x, y): (isize, isize), (dx, dy): (isize, isize)| {
            let step = (1..=most).find(|k| !still.at(x + k * dx, y + k * dy))?;
            let (x, y) = (x + step * dx, y + step * dy);
            (x >= 0 && y >= 0 && x < width && y < height).then_some((step, (y * width + x) as u32))
        };
        let mut bridges = Vec::new();
        for (x, y) in still.pixels() {
            let at = (x as isize, y as isize);
            for (dx, dy) in [(1, 0), (0, 1), (1, 1), (1, -1)] {
                let (Some((forth, a)), Some((back, b))) = (out(at, (dx, dy)), out(at, (-dx, -dy))) else {
                    continue;
                };
                if forth + back <= most {
                    bridges.push([(at.1 * width + at.0) as u32, a, b]);
                }
            }
        }
        Self(bridges)
    }

    /// Adds to `silhouette`, of the whole picture, what they cross.
    pub(super) fn join(&self, silhouette: &mut Mask) {
        let ends = |&[_, a, b]: &[u32; 3]| silhouette.bits[a as usize] && silhouette.bits[b as usize];
        let crossed: Vec<u32> = self.0.iter().filter(|bridge| ends(bridge)).map(|bridge| bridge[0]).collect();
        crossed.into_iter().for_each(|at| silhouette.bits[at as usize] = true);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_is_bridged_where_the_mechanism_crosses_it_and_a_bracket_before_its_end_is_not() {
        let fill = |mask: &mut Mask, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>| {
            rows.for_each(|y| columns.clone().for_each(|x| mask.set(x as isize, y as isize)));
        };
        let (mut still, mut seen) = (Mask::empty(0, 0, 300, 200), Mask::empty(0, 0, 300, 200));
        fill(&mut still, 0..300, 100..108);
        fill(&mut still, 40..60, 0..30);
        fill(&mut seen, 45..55, 30..100);
        fill(&mut seen, 45..55, 108..160);
        Bridges::over(&still).join(&mut seen);
        assert!((100..108).all(|y| seen.at(50, y)), "crossed");
        assert!(!seen.at(30, 104) && !seen.at(200, 104) && !seen.at(50, 20));
    }
}
