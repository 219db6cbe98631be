//! A silhouette's edge as closed lines.

use std::collections::HashMap;

use camera::calibration::Px;
use vision::Mask;

/// A shorter outline is a speck and is left out \[px\]. Chosen.
const OUTLINE_MIN_LENGTH_PX: usize = 12;
/// Distance by which a simplified outline may miss the pixels' corners \[px\]; smooths the steps of a slope. Chosen.
const OUTLINE_TOLERANCE_PX: f64 = 0.75;

/// A corner of a pixel.
type Corner = [usize; 2];

/// The edges of `mask`, outer and inner ones, as closed lines in the picture.
pub(super) fn outline(mask: &Mask) -> Vec<Vec<Px>> {
    let mut sides: HashMap<Corner, Vec<Corner>> = HashMap::new();
    let mut begins = Vec::new();
    for (x, y) in mask.pixels() {
        let neighbour = |dx: isize, dy: isize| mask.at(x as isize + dx, y as isize + dy);
        // with the inside to the right
        for (is_inside, from, to) in [
            (neighbour(0, -1), [x, y], [x + 1, y]),
            (neighbour(1, 0), [x + 1, y], [x + 1, y + 1]),
            (neighbour(0, 1), [x + 1, y + 1], [x, y + 1]),
            (neighbour(-1, 0), [x, y + 1], [x, y]),
        ] {
            if !is_inside {
                sides.entry(from).or_default().push(to);
                begins.push(from);
            }
        }
    }
    let mut lines = Vec::new();
    for begin in begins {
        let mut line = Vec::new();
        let mut at = begin;
        while let Some(next) = sides.get_mut(&at).and_then(Vec::pop) {
            line.push(at);
            at = next;
        }
        if line.len() >= OUTLINE_MIN_LENGTH_PX {
            lines.push(smooth(&line));
        }
    }
    lines
}

/// Simplifies a closed line: leaves out the corners that it does not need.
fn smooth(line: &[Corner]) -> Vec<Px> {
    // the centre of a picture's first pixel is its origin
    let mut points: Vec<Px> = line.iter().map(|corner| corner.map(|c| c as f64 - 0.5)).collect();
    // the first point always stays, so it has to be a corner, not the middle of a side
    let begin = farthest(&points, points[0]);
    points.rotate_left(begin);
    points.push(points[0]);
    let far = farthest(&points, points[0]);
    let mut kept = vec![0];
    simplify(&points, 0, far, &mut kept);
    simplify(&points, far, points.len() - 1, &mut kept);
    kept.pop();
    kept.into_iter().map(|i| points[i]).collect()
}

/// Of `points` after the one at `from` up to the one at `to`, those that a line has to pass (Douglas and Peucker 1973).
fn simplify(points: &[Px], from: usize, to: usize, kept: &mut Vec<usize>) {
    let mut open = vec![(from, to)];
    while let Some((from, to)) = open.pop() {
        let off = |i: &usize| line_distance(points[*i], points[from], points[to]);
        let farthest = (from + 1..to).max_by(|a, b| off(a).total_cmp(&off(b)));
        match farthest.filter(|i| off(i) > OUTLINE_TOLERANCE_PX) {
            Some(middle) => open.extend([(middle, to), (from, middle)]),
            None => kept.push(to),
        }
    }
}

/// Which of `points` is farthest from `from`.
fn farthest(points: &[Px], from: Px) -> usize {
    let off = |i: &usize| distance(points[*i], from);
    (0..points.len()).max_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(0)
}

fn distance(a: Px, b: Px) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// How far `point` is from the line through `a` and `b`.
fn line_distance(point: Px, a: Px, b: Px) -> f64 {
    let length = distance(a, b);
    if length == 0.0 {
        return distance(point, a);
    }
    ((b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0])).abs() / length
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(inside: impl Fn(f64, f64) -> bool) -> Mask {
        let mut mask = Mask::empty(10, 20, 60, 50);
        for (i, bit) in mask.bits.iter_mut().enumerate() {
            *bit = inside((10 + i % 60) as f64, (20 + i / 60) as f64);
        }
        mask
    }

    #[test]
    fn rectangle_has_four_corners_and_a_hole_is_a_line_of_its_own() {
        let frame = |x: f64, y: f64, grow: f64| {
            (20.0 - grow..=50.0 + grow).contains(&x) && (30.0 - grow..=50.0 + grow).contains(&y)
        };
        let lines = outline(&mask(|x, y| frame(x, y, 5.0) && !frame(x, y, 0.0)));
        assert_eq!(lines.len(), 2);
        let mut corners = lines[0].clone();
        corners.sort_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(corners, [[14.5, 24.5], [14.5, 55.5], [55.5, 24.5], [55.5, 55.5]]);
        assert_eq!(lines[1].len(), 4);
    }

    #[test]
    fn disc_is_drawn_by_few_points_that_all_lie_on_its_edge() {
        let (centre, radius) = ([38.0, 44.0], 17.0);
        let lines = outline(&mask(|x, y| distance([x, y], centre) < radius));
        assert_eq!(lines.len(), 1);
        assert!((8..40).contains(&lines[0].len()), "{}", lines[0].len());
        for point in &lines[0] {
            assert!((distance(*point, centre) - radius).abs() < 1.0, "{point:?}");
        }
    }

    #[test]
    fn corners_that_touch_and_specks_do_not_trip_it() {
        let lines = outline(&mask(|x, y| (x as usize / 8 + y as usize / 8).is_multiple_of(2)));
        assert!(lines.iter().all(|line| line.len() >= 3), "{lines:?}");
        assert!(outline(&mask(|x, y| x == 30.0 && y == 30.0)).is_empty());
        assert!(outline(&mask(|_, _| false)).is_empty());
    }
}
