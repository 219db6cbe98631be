//! Places and ways in a plane: of motion \[m\], or of the picture \[px\].

/// A place in the plane of motion, to the right and up \[m\].
pub(super) type Place = [f64; 2];

pub(super) fn plus(a: Place, b: Place) -> Place {
    [a[0] + b[0], a[1] + b[1]]
}

pub(super) fn minus(a: Place, b: Place) -> Place {
    [a[0] - b[0], a[1] - b[1]]
}

pub(super) fn scaled(a: Place, by: f64) -> Place {
    [a[0] * by, a[1] * by]
}

pub(super) fn dot(a: Place, b: Place) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

pub(super) fn norm(a: Place) -> f64 {
    (a[0] * a[0] + a[1] * a[1]).sqrt()
}

pub(super) fn unit(a: Place) -> Place {
    scaled(a, 1.0 / norm(a).max(f64::MIN_POSITIVE))
}

pub(super) fn lerp(a: Place, b: Place, share: f64) -> Place {
    plus(a, scaled(minus(b, a), share))
}

/// A quarter turn counter-clockwise.
pub(super) fn across(a: Place) -> Place {
    [-a[1], a[0]]
}

/// `a` turned by the angle of this cosine and sine.
pub(super) fn turned(a: Place, [cos, sin]: [f64; 2]) -> Place {
    [cos * a[0] - sin * a[1], sin * a[0] + cos * a[1]]
}
