//! Outlines as signed distances: negative inside, in pixels.

/// A place in a picture, column and row \[px\]; the centre of the top left pixel is (0, 0).
pub type Px = [f64; 2];

/// One outline.
#[derive(Debug, Clone)]
pub enum Shape {
    /// A bar from one point past another: its ends lie `past` beyond them; corners of radius `round`.
    Bar {
        /// Its axis.
        ends: [Px; 2],
        /// How far it reaches past each end of its axis.
        past: [f64; 2],
        /// Half its width.
        half: f64,
        /// Radius of its corners.
        round: f64,
    },
    /// A tapered band along a line, with square ends.
    Band {
        /// The line.
        line: Vec<Px>,
        /// Half its width at each point of the line.
        half: Vec<f64>,
    },
    /// Two discs and what a string around both holds.
    Egg {
        /// Their centres.
        ends: [Px; 2],
        /// Their radii.
        radii: [f64; 2],
    },
    /// A convex polygon, its corners in turn, as [`Self::polygon`] gives them.
    Polygon(Vec<Px>),
    /// An ellipse.
    Ellipse {
        /// Its centre.
        centre: Px,
        /// Its half axes.
        axes: [f64; 2],
        /// How far the first one is turned from the columns' direction to the rows' \[rad\].
        turn: f64,
    },
    /// A disc.
    Disc {
        /// Its centre.
        centre: Px,
        /// Its radius.
        radius: f64,
    },
    /// A ring, as a bubble's rim.
    Ring {
        /// Its centre.
        centre: Px,
        /// The rim's middle radius.
        radius: f64,
        /// Half the rim's width.
        half: f64,
    },
}

fn along(from: Px, to: Px, p: Px) -> (f64, f64, f64) {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let length = dx.hypot(dy).max(1e-12);
    let (px, py) = (p[0] - from[0], p[1] - from[1]);
    ((px * dx + py * dy) / length, (py * dx - px * dy) / length, length)
}

impl Shape {
    /// The convex outline of some points.
    pub fn polygon(mut points: Vec<Px>) -> Self {
        points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        // Andrew's monotone chain: once there, once back.
        let half = |points: &mut dyn Iterator<Item = &Px>| {
            let mut chain: Vec<Px> = Vec::new();
            for &point in points {
                let turns_back = |chain: &[Px]| match chain {
                    [.., a, b] => {
                        (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0]) <= 1e-9
                    }
                    _ => false,
                };
                while turns_back(&chain) {
                    chain.pop();
                }
                chain.push(point);
            }
            chain.pop();
            chain
        };
        let mut corners = half(&mut points.iter());
        corners.extend(half(&mut points.iter().rev()));
        Self::Polygon(corners)
    }

    /// Signed distance of `p` \[px\]; exact near the outline.
    pub fn distance(&self, p: Px) -> f64 {
        match self {
            Self::Bar { ends, past, half, round } => {
                let (u, v, length) = along(ends[0], ends[1], p);
                let middle = (length + past[1] - past[0]) / 2.0;
                let reach = (length + past[0] + past[1]) / 2.0;
                let (a, b) = ((u - middle).abs() - reach + round, v.abs() - half + round);
                a.max(0.0).hypot(b.max(0.0)) + a.max(b).min(0.0) - round
            }
            Self::Band { line, half } => {
                let last = line.len() - 2;
                // Pieces with round joints, cut square at both ends; the band bends too little to come behind one.
                let piece = |i: usize| {
                    let (u, v, length) = along(line[i], line[i + 1], p);
                    let share = (u / length).clamp(0.0, 1.0);
                    let side = half[i] + share * (half[i + 1] - half[i]);
                    (u - length).max(-u).max(0.0).hypot(v) - side
                };
                let band = (0..=last).map(piece).fold(f64::INFINITY, f64::min);
                let (before, ..) = along(line[0], line[1], p);
                let (after, _, length) = along(line[last], line[last + 1], p);
                band.max(-before).max(after - length)
            }
            Self::Egg { ends, radii: [first, second] } => {
                let (u, v, length) = along(ends[0], ends[1], p);
                let v = v.abs();
                // The straight side leans by the difference of the radii.
                let lean = (first - second) / length;
                let upright = (1.0 - lean * lean).sqrt();
                match upright * u - lean * v {
                    k if k < 0.0 => u.hypot(v) - first,
                    k if k > upright * length => (u - length).hypot(v) - second,
                    _ => lean * u + upright * v - first,
                }
            }
            Self::Polygon(corners) => {
                let next = corners.iter().cycle().skip(1);
                let sides = corners.iter().zip(next).map(|(from, to)| along(*from, *to, p));
                let (mut outside, mut nearest) = (f64::NEG_INFINITY, f64::INFINITY);
                for (u, v, length) in sides {
                    outside = outside.max(-v);
                    nearest = nearest.min((u - length).max(-u).max(0.0).hypot(v));
                }
                if outside > 0.0 { nearest } else { outside }
            }
            Self::Ellipse { centre, axes: [a, b], turn } => {
                let (sin, cos) = turn.sin_cos();
                let (x, y) = (p[0] - centre[0], p[1] - centre[1]);
                let (u, v) = ((cos * x + sin * y) / a, (cos * y - sin * x) / b);
                let from_centre = u.hypot(v).max(1e-12);
                // To first order.
                (from_centre - 1.0) * from_centre / (u / a).hypot(v / b).max(1e-12)
            }
            Self::Disc { centre, radius } => (p[0] - centre[0]).hypot(p[1] - centre[1]) - radius,
            Self::Ring { centre, radius, half } => {
                ((p[0] - centre[0]).hypot(p[1] - centre[1]) - radius).abs() - half
            }
        }
    }

    /// The same turned by `angle` \[rad\], from the columns' direction to the rows', about (0, 0), which then lies at `centre`.
    #[must_use]
    pub fn placed(&self, at: Px, angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        let place = |[x, y]: Px| [at[0] + cos * x - sin * y, at[1] + sin * x + cos * y];
        match self.clone() {
            Self::Bar { ends, past, half, round } => Self::Bar { ends: ends.map(place), past, half, round },
            Self::Band { line, half } => Self::Band { line: line.into_iter().map(place).collect(), half },
            Self::Egg { ends, radii } => Self::Egg { ends: ends.map(place), radii },
            Self::Polygon(corners) => Self::Polygon(corners.into_iter().map(place).collect()),
            Self::Ellipse { centre, axes, turn } => {
                Self::Ellipse { centre: place(centre), axes, turn: turn + angle }
            }
            Self::Disc { centre, radius } => Self::Disc { centre: place(centre), radius },
            Self::Ring { centre, radius, half } => Self::Ring { centre: place(centre), radius, half },
        }
    }

    /// The rectangle that holds it: least column and row, greatest column and row.
    pub fn bounds(&self) -> [f64; 4] {
        let around = |points: &[Px], reach: f64| {
            let of = |axis: usize, worst: f64, pick: fn(f64, f64) -> f64| {
                points.iter().map(|point| point[axis]).fold(worst, pick)
            };
            [
                of(0, f64::INFINITY, f64::min) - reach,
                of(1, f64::INFINITY, f64::min) - reach,
                of(0, f64::NEG_INFINITY, f64::max) + reach,
                of(1, f64::NEG_INFINITY, f64::max) + reach,
            ]
        };
        match self {
            Self::Bar { ends, past, half, .. } => around(ends, half + past[0].max(past[1])),
            Self::Band { line, half } => around(line, half.iter().copied().fold(0.0, f64::max)),
            Self::Egg { ends, radii } => around(ends, radii[0].max(radii[1])),
            Self::Polygon(corners) => around(corners, 0.0),
            Self::Ellipse { centre, axes, .. } => around(&[*centre], axes[0].max(axes[1])),
            Self::Disc { centre, radius } => around(&[*centre], *radius),
            Self::Ring { centre, radius, half } => around(&[*centre], radius + half),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_to_the_outline() {
        let bar = Shape::Bar { ends: [[0.0, 0.0], [10.0, 0.0]], past: [2.0, 1.0], half: 3.0, round: 0.0 };
        for (p, wanted) in [([5.0, 4.0], 1.0), ([-3.0, 0.0], 1.0), ([12.0, 0.0], 1.0), ([5.0, 0.0], -3.0)] {
            assert!((bar.distance(p) - wanted).abs() < 1e-12, "{p:?}: {}", bar.distance(p));
        }
        let egg = Shape::Egg { ends: [[0.0, 0.0], [10.0, 0.0]], radii: [5.0, 2.0] };
        for (p, wanted) in [([-6.0, 0.0], 1.0), ([13.0, 0.0], 1.0), ([0.0, 0.0], -5.0)] {
            assert!((egg.distance(p) - wanted).abs() < 1e-9, "{p:?}: {}", egg.distance(p));
        }
        let square = Shape::polygon(vec![[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [2.0, 2.0], [0.0, 4.0]]);
        for (p, wanted) in [([2.0, -1.0], 1.0), ([2.0, 3.0], -1.0), ([7.0, 8.0], 5.0)] {
            assert!((square.distance(p) - wanted).abs() < 1e-9, "{p:?}: {}", square.distance(p));
        }
        let ellipse =
            Shape::Ellipse { centre: [0.0, 0.0], axes: [10.0, 4.0], turn: 0.0 }.placed([3.0, 1.0], 0.5);
        let (sin, cos) = 0.5_f64.sin_cos();
        for out in [10.0, 10.5] {
            let d = ellipse.distance([3.0 + out * cos, 1.0 + out * sin]);
            assert!((d - (out - 10.0)).abs() < 0.03, "{d} {out}");
        }
        let band =
            Shape::Band { line: vec![[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]], half: vec![4.0, 3.0, 2.0] };
        for (p, wanted) in [([10.0, 5.0], 2.0), ([-1.0, 0.0], 1.0), ([20.0, 0.0], 0.0), ([5.0, 3.5], 0.0)] {
            assert!((band.distance(p) - wanted).abs() < 1e-9, "{p:?}: {}", band.distance(p));
        }
    }
}
