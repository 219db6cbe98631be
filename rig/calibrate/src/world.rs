//! Where the world lies in the plane that was fitted: its origin, and which way is up. From above y stands for z.

use nalgebra::{Matrix3, Rotation2, Vector2};

use camera::calibration::{Plane, Px};

/// What says which way the world's axes point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Upright {
    /// x along the picture's rows where the origin is seen, lens distortion left out.
    Rows,
    /// Two places on a plumb line, lower and upper: z points from one to the other.
    Plumb([Px; 2]),
    /// Two places on still water, left and right: x points from one to the other.
    Level([Px; 2]),
}

/// Two places that give no direction.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "the two places that say which way is up are {0:.1} px apart; at least {DIRECTION_DISTANCE_MIN_PX} px make a direction"
)]
pub struct TooNear(f64);

/// Two places nearer than this give no direction \[px\] (chosen).
const DIRECTION_DISTANCE_MIN_PX: f64 = 50.0;

/// The map from the plane's own world to that with its origin seen at `origin_px`.
///
/// # Errors
/// [`TooNear`].
pub(super) fn world_from_plane(
    plane: &Plane,
    origin_px: Px,
    upright: Upright,
) -> Result<Matrix3<f64>, TooNear> {
    let across = |[from, to]: [Px; 2]| {
        let apart = (Vector2::from(to) - Vector2::from(from)).norm();
        if apart < DIRECTION_DISTANCE_MIN_PX {
            return Err(TooNear(apart));
        }
        Ok(Vector2::from(plane.metres(to)) - Vector2::from(plane.metres(from)))
    };
    let x = match upright {
        Upright::Rows => plane.straight_slope(origin_px).column(0).into_owned(),
        Upright::Level(places) => across(places)?,
        Upright::Plumb(places) => {
            let up = across(places)?;
            Vector2::new(up.y, -up.x)
        }
    };
    let turn = Rotation2::new(-x.y.atan2(x.x));
    let shift = -(turn * Vector2::from(plane.metres(origin_px)));
    let mut map = turn.to_homogeneous();
    map[(0, 2)] = shift.x;
    map[(1, 2)] = shift.y;
    Ok(map)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORIGIN_PX: Px = [320.0, 60.0];

    /// A square camera's plane in a world turned and moved.
    fn elsewhere() -> Plane {
        let mut map = Rotation2::new(0.7).to_homogeneous();
        (map[(0, 2)], map[(1, 2)]) = (0.3, -0.2);
        Plane::square(0.001, ORIGIN_PX).in_world(&map).unwrap()
    }

    fn far(upright: Upright) -> [f64; 2] {
        let plane = elsewhere();
        let world = plane.in_world(&world_from_plane(&plane, ORIGIN_PX, upright).unwrap()).unwrap();
        assert!(world.metres(ORIGIN_PX).iter().all(|x| x.abs() < 1e-12));
        world.metres([420.0, 30.0])
    }

    #[test]
    fn rows_plumb_line_and_water_level_say_which_way_is_up() {
        for upright in [
            Upright::Rows,
            Upright::Plumb([[5.0, 400.0], [5.0, 20.0]]),
            Upright::Level([[10.0, 77.0], [600.0, 77.0]]),
        ] {
            let [x, z] = far(upright);
            assert!((x - 0.1).abs() < 1e-12 && (z - 0.03).abs() < 1e-12, "{upright:?} {x} {z}");
        }
        // A camera turned by a quarter: the plumb line runs along its rows.
        let [x, z] = far(Upright::Plumb([[100.0, 50.0], [500.0, 50.0]]));
        assert!((x + 0.03).abs() < 1e-12 && (z - 0.1).abs() < 1e-12, "{x} {z}");
    }

    #[test]
    fn one_place_is_no_direction() {
        let plane = elsewhere();
        let refused = world_from_plane(&plane, ORIGIN_PX, Upright::Level([[1.0, 1.0], [1.0, 2.0]]));
        assert_eq!(refused, Err(TooNear(1.0)));
    }
}
