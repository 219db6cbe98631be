//! The silhouette's edge as sub-pixel points.

use super::Mask;
use super::background::Contrast;
use camera::calibration::Px;

/// Every place on a pixel's four sides where the contrast passes half the mechanism's, along the edge of
/// `part`; about 1.3 a pixel of edge, in the order of their pixels. Places beside the picture's border or
/// within `clear_px` of `blocked` are not edges of the mechanism and left out.
pub fn contour(contrast: &Contrast, part: &Mask, blocked: Option<&Mask>, clear_px: isize) -> Vec<Px> {
    let half = f64::from(contrast.level) / 2.0;
    let (width, height) = (contrast.width as isize, contrast.height as isize);
    let hidden = |x: isize, y: isize| {
        blocked.is_some_and(|mask| {
            (-clear_px..=clear_px).any(|dy| (-clear_px..=clear_px).any(|dx| mask.at(x + dx, y + dy)))
        })
    };
    let mut points = Vec::new();
    for (y, bits) in part.bits.chunks_exact(part.width.max(1)).enumerate() {
        let row = part.top + y;
        let (above, below) = (row.checked_sub(1).map_or(&[][..], |row| part.row(row)), part.row(row + 1));
        let is_set = |row: &[bool], x: usize| row.get(x).is_some_and(|bit| *bit);
        for x in (0..bits.len()).filter(|&x| bits[x]) {
            // To the right, below, to the left, above.
            let beside = [is_set(bits, x + 1), is_set(below, x), x > 0 && bits[x - 1], is_set(above, x)];
            if beside == [true; 4] {
                continue;
            }
            let column = part.left + x;
            let inside = f64::from(contrast.values[row * contrast.width + column]);
            let (x, y) = (column as isize, row as isize);
            for ((dx, dy), within) in [(1, 0), (0, 1), (-1, 0), (0, -1)].into_iter().zip(beside) {
                let (nx, ny) = (x + dx, y + dy);
                if within || nx < 0 || ny < 0 || nx >= width || ny >= height || hidden(nx, ny) {
                    continue;
                }
                let outside = f64::from(contrast.values[(ny * width + nx) as usize]);
                // A filled hole's or a bridged gap's rim does not pass the half here.
                if inside > half && outside <= half {
                    let share = (inside - half) / (inside - outside);
                    points.push([x as f64 + share * dx as f64, y as f64 + share * dy as f64]);
                }
            }
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disc whose contrast falls linearly over its edge is read to the curvature within a pixel.
    const CURVED: f64 = 0.05;

    #[test]
    fn soft_disc_gives_points_on_its_circle() {
        let (centre, radius) = ([20.3, 18.6], 9.4);
        let mut contrast =
            Contrast { width: 40, height: 40, values: vec![0.0; 1600], level: 100.0, noise: 0.3 };
        for (i, value) in contrast.values.iter_mut().enumerate() {
            let d = ((i % 40) as f64 - centre[0]).hypot((i / 40) as f64 - centre[1]);
            *value = (100.0 * (radius - d + 1.0) / 2.0).clamp(0.0, 100.0) as f32;
        }
        let part = contrast.silhouette();
        let points = contour(&contrast, &part, None, 2);
        assert!(points.len() > 55);
        for p in points {
            let d = (p[0] - centre[0]).hypot(p[1] - centre[1]);
            assert!((d - radius).abs() < CURVED, "{p:?} {d}");
        }
    }

    #[test]
    fn edge_made_by_the_static_mask_is_left_out() {
        let mut values = vec![0.0; 400];
        values.chunks_mut(20).skip(5).take(8).for_each(|row| row[..12].fill(80.0));
        let contrast = Contrast { width: 20, height: 20, values, level: 80.0, noise: 0.3 };
        let mut blocked = Mask::empty(12, 0, 4, 20);
        blocked.bits.fill(true);
        let points = contour(&contrast, &contrast.silhouette(), Some(&blocked), 2);
        assert!(!points.is_empty() && points.iter().all(|p| p[0] < 11.0), "{points:?}");
    }
}
