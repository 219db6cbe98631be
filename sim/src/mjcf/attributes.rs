//! One element's attributes, its defaults included, checked and turned into numbers.

use std::collections::HashMap;
use std::f64::consts::TAU;
use std::fmt::Display;

use super::element::{Attribute, Element};
use super::error::Refusals;
use super::tables::{Table, table};
use crate::math::{Mat3, Quat, Vec3};
use crate::model::shape;

/// Attributes by name.
pub(super) type Values<'a> = HashMap<&'a str, &'a Attribute>;

/// One element with all its attributes, those from its default classes too. A value that is refused is replaced by its default.
pub(super) struct Attributes<'a> {
    pub(super) element: &'a Element,
    refusals: &'a Refusals,
    values: Values<'a>,
}

/// How angles are written.
#[derive(Debug, Clone)]
pub(super) struct Angles {
    pub(super) degrees: bool,
    pub(super) euler_sequence: String,
}

impl Angles {
    /// `x` as written, in radians.
    pub(super) fn radians(&self, x: f64) -> f64 {
        if self.degrees { x.to_radians() } else { x }
    }

    /// The orientation of the three Euler angles, as written.
    pub(super) fn turn(&self, turns: [f64; 3]) -> Quat<f64> {
        let mut q = Quat::IDENTITY;
        for (letter, turn) in self.euler_sequence.chars().zip(turns) {
            let axis = match letter.to_ascii_lowercase() {
                'x' => [1.0, 0.0, 0.0],
                'y' => [0.0, 1.0, 0.0],
                _ => [0.0, 0.0, 1.0],
            };
            let by = self.turn_about(Vec3(axis), turn);
            // lower case turns with the body, upper case about fixed axes
            q = if letter.is_ascii_lowercase() { q.product(by) } else { by.product(q) };
        }
        q
    }

    /// Whole turns, of which a large angle may have any number, turn nothing.
    fn turn_about(&self, axis: Vec3<f64>, angle: f64) -> Quat<f64> {
        Quat::from_rotation_vector(axis * (self.radians(angle) % TAU))
    }
}

/// The ways to write an orientation.
const ORIENTATION: [&str; 5] = ["quat", "axisangle", "xyaxes", "zaxis", "euler"];

/// The element's own attributes.
pub(super) fn own(element: &Element) -> Values<'_> {
    element.attributes.iter().map(|attribute| (attribute.name.as_str(), attribute)).collect()
}

/// Whether the table of the element `tag` lets the attribute be read; refused where it would change the motion.
fn is_read(tag: &str, table: &Table, attribute: &Attribute, refusals: &Refusals) -> bool {
    let Attribute { name, value, place } = attribute;
    if table.read.contains(&name.as_str()) {
        return true;
    }
    if table.passed_over.contains(&name.as_str()) {
        return false;
    }
    let instead = match table.only.iter().find(|(known, _)| known == name) {
        Some((_, allowed)) if allowed.iter().any(|allowed| same(allowed, value)) => return false,
        Some((_, allowed)) => format!("only \"{}\" is", allowed[0]),
        None => "remove it".into(),
    };
    refusals.add(place, format!("<{tag}> attribute {name}=\"{value}\" is not supported; {instead}"));
    false
}

/// Equal as numbers where both are, else as text.
pub(super) fn same(a: &str, b: &str) -> bool {
    let numbers = |text: &str| text.split_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>();
    match (numbers(a), numbers(b)) {
        (Ok(a), Ok(b)) => a == b,
        _ => a == b,
    }
}

impl<'a> Attributes<'a> {
    /// The element's attributes over those of its default class, after a look at its table.
    pub(super) fn new(element: &'a Element, defaults: Option<&Values<'a>>, refusals: &'a Refusals) -> Self {
        Self::of_kind(&element.tag, element, defaults, refusals)
    }

    /// The same for an element of those that share the table `kind`.
    pub(super) fn of_kind(
        kind: &str,
        element: &'a Element,
        defaults: Option<&Values<'a>>,
        refusals: &'a Refusals,
    ) -> Self {
        let mut values = defaults.cloned().unwrap_or_default();
        let own = own(element);
        // an orientation can be given in several ways: the element's own way hides the defaults'
        if ORIENTATION.iter().any(|name| own.contains_key(name)) {
            values.retain(|name, _| !ORIENTATION.contains(name));
        }
        values.extend(own);
        let table = table(kind);
        values.retain(|_, attribute| {
            table.is_some_and(|table| is_read(&element.tag, table, attribute, refusals))
        });
        Self { element, refusals, values }
    }

    /// The element's name, or its kind and place where it has none; refused where one of `taken` has it.
    pub(super) fn name<'n>(
        &self,
        kind: &str,
        place: usize,
        mut taken: impl Iterator<Item = &'n String>,
    ) -> (String, bool) {
        let Some(name) = self.text("name").filter(|name| !name.is_empty()) else {
            return (format!("{kind}#{place}"), false);
        };
        if taken.any(|taken| taken == name) {
            let problem = format!("<{}> name \"{name}\" is taken by an earlier one", self.element.tag);
            self.refusals.add(&self.element.place, problem);
        }
        (name.into(), true)
    }

    pub(super) fn text(&self, name: &str) -> Option<&'a str> {
        self.values.get(name).map(|attribute| attribute.value.as_str())
    }

    /// Refuses the attribute's value.
    pub(super) fn invalid(&self, name: &str, wanted: impl Display) {
        let given = self.values.get(name);
        let (value, place) = given.map_or(("", &self.element.place), |given| (&given.value, &given.place));
        let tag = &self.element.tag;
        self.refusals.add(place, format!("<{tag}> attribute {name}=\"{value}\" must be {wanted}"));
    }

    /// Refuses the element for want of an attribute.
    pub(super) fn missing(&self, name: &str) {
        let tag = &self.element.tag;
        self.refusals.add(&self.element.place, format!("<{tag}> needs the attribute {name}"));
    }

    /// Refuses the element, called `name`, because it does not go with others.
    pub(super) fn inconsistent(&self, name: &str, problem: impl Display) {
        self.refusals.add(&self.element.place, format!("<{}> \"{name}\" {problem}", self.element.tag));
    }

    /// The text of an attribute that must be there.
    pub(super) fn needed(&self, name: &str) -> Option<&'a str> {
        let text = self.text(name);
        if text.is_none() {
            self.missing(name);
        }
        text
    }

    /// The place in `known` of the name that the attribute gives; `of`: what it is the name of.
    pub(super) fn named<'n>(
        &self,
        attribute: &str,
        of: &str,
        mut known: impl Iterator<Item = &'n String>,
    ) -> Option<usize> {
        let name = self.needed(attribute)?;
        let place = known.position(|known| known == name);
        if place.is_none() {
            self.invalid(attribute, format_args!("the name of a {of}"));
        }
        place
    }

    /// Between `least` and `most` finite numbers.
    pub(super) fn list(&self, name: &str, least: usize, most: usize) -> Option<Vec<f64>> {
        let text = self.text(name)?;
        let numbers: Option<Vec<f64>> =
            text.split_whitespace().map(|word| word.parse().ok().filter(|x: &f64| x.is_finite())).collect();
        let numbers = numbers.filter(|numbers| (least..=most).contains(&numbers.len()));
        match &numbers {
            Some(_) => {}
            None if least == most => self.invalid(name, format_args!("{least} finite numbers")),
            None => self.invalid(name, format_args!("{least} to {most} finite numbers")),
        }
        numbers
    }

    /// Exactly N finite numbers.
    pub(super) fn array<const N: usize>(&self, name: &str) -> Option<[f64; N]> {
        self.list(name, N, N)?.try_into().ok()
    }

    /// Up to N finite numbers, the missing ones as in `usual`.
    pub(super) fn first_of<const N: usize>(&self, name: &str, usual: [f64; N]) -> [f64; N] {
        let numbers = self.list(name, 1, N).unwrap_or_default();
        std::array::from_fn(|i| numbers.get(i).copied().unwrap_or(usual[i]))
    }

    /// Up to three finite numbers, the missing ones 0.
    pub(super) fn up_to_three(&self, name: &str) -> [f64; 3] {
        self.first_of(name, [0.0; 3])
    }

    pub(super) fn vector(&self, name: &str) -> Option<Vec3<f64>> {
        self.array(name).map(Vec3)
    }

    pub(super) fn number(&self, name: &str, default: f64) -> f64 {
        self.array(name).map_or(default, |[x]| x)
    }

    /// A finite number, not below 0.
    pub(super) fn not_negative(&self, name: &str, default: f64) -> f64 {
        let x = self.number(name, default);
        if x < 0.0 {
            self.invalid(name, "not below 0");
            return default;
        }
        x
    }

    /// A finite number above 0.
    pub(super) fn positive(&self, name: &str, default: f64) -> f64 {
        let x = self.number(name, default);
        if x <= 0.0 {
            self.invalid(name, "above 0");
            return default;
        }
        x
    }

    /// A whole number.
    pub(super) fn whole<T: std::str::FromStr>(&self, name: &str, default: T, wanted: &str) -> T {
        let Some(text) = self.text(name) else { return default };
        text.trim().parse().unwrap_or_else(|_| {
            self.invalid(name, wanted);
            default
        })
    }

    /// A soft constraint's time constant and damping ratio; or, below 0, stiffness and damping.
    pub(super) fn solref(&self, name: &str, usual: [f64; 2]) -> [f64; 2] {
        let solref = self.first_of(name, usual);
        if (solref[0] > 0.0) != (solref[1] > 0.0) {
            self.invalid(name, "two numbers above 0, or two that are not");
        }
        solref
    }

    /// Two rising numbers.
    fn range(&self, name: &str) -> Option<[f64; 2]> {
        match self.array(name)? {
            // MuJoCo's way of saying there is none
            [0.0, 0.0] => None,
            [low, high] if low < high => Some([low, high]),
            _ => {
                self.invalid(name, "two rising numbers");
                None
            }
        }
    }

    /// One of several words.
    pub(super) fn one_of<T: Copy>(&self, name: &str, words: &[(&str, T)], default: T) -> T {
        let Some(text) = self.text(name) else { return default };
        let found = words.iter().find(|(word, _)| *word == text);
        found.map_or_else(
            || {
                let known: Vec<_> = words.iter().map(|(word, _)| *word).collect();
                self.invalid(name, format_args!("one of: {}", known.join(", ")));
                default
            },
            |(_, value)| *value,
        )
    }

    /// The range of `range_name` where it applies: as `limited_name` says, or by its being there.
    pub(super) fn limited_range(
        &self,
        range_name: &str,
        limited_name: &str,
        autolimits: bool,
    ) -> Option<[f64; 2]> {
        let range = self.range(range_name);
        let limited =
            self.one_of(limited_name, &[("true", Some(true)), ("false", Some(false)), ("auto", None)], None);
        match limited {
            Some(false) => None,
            Some(true) if range.is_none() => {
                self.missing(range_name);
                None
            }
            None if !autolimits && range.is_some() => {
                let problem =
                    format_args!("has a {range_name} but does not say {limited_name}, and autolimits is off");
                self.inconsistent(self.text("name").unwrap_or(""), problem);
                None
            }
            _ => range,
        }
    }

    /// `v` at unit length; refused where it has none.
    pub(super) fn unit<const N: usize>(&self, name: &str, v: [f64; N]) -> Option<[f64; N]> {
        let unit = unit_length(v);
        if unit.is_none() {
            self.invalid(name, "of nonzero length");
        }
        unit
    }

    /// `parent_from_child` from whichever of the five forms is given.
    pub(super) fn orientation(&self, angles: &Angles) -> Quat<f64> {
        let mut given = ORIENTATION.into_iter().filter(|name| self.text(name).is_some());
        let Some(name) = given.next() else { return Quat::IDENTITY };
        if let Some(other) = given.next() {
            self.invalid(other, format_args!("absent beside {name}"));
        }
        self.turned_by(name, angles).unwrap_or(Quat::IDENTITY)
    }

    fn turned_by(&self, name: &str, angles: &Angles) -> Option<Quat<f64>> {
        match name {
            "quat" => Some(Quat(self.unit(name, self.array::<4>(name)?)?)),
            "axisangle" => {
                let [x, y, z, angle] = self.array::<4>(name)?;
                let axis = Vec3(self.unit(name, [x, y, z])?);
                Some(angles.turn_about(axis, angle))
            }
            "xyaxes" => {
                let [a, b, c, d, e, f] = self.array::<6>(name)?;
                let x = Vec3(self.unit(name, [a, b, c])?);
                let y = Vec3([d, e, f]);
                let y = Vec3(self.unit(name, (y - x * x.dot(y)).0)?);
                Some(from_columns(x, y, x.cross(y)))
            }
            "zaxis" => Some(from_z(Vec3(self.unit(name, self.array::<3>(name)?)?))),
            _ => Some(angles.turn(self.array::<3>(name)?)),
        }
    }
}

/// Vectors shorter than this have no direction, and those as near to length 1 are left as they are: as in MuJoCo's compiler. What was
/// written at unit length so reads back to the same bits.
const LENGTH_TOLERANCE: f64 = 1e-14;

/// `v` at unit length; none where it has no direction.
fn unit_length<const N: usize>(v: [f64; N]) -> Option<[f64; N]> {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let is_unit = (length - 1.0).abs() <= LENGTH_TOLERANCE;
    (length >= LENGTH_TOLERANCE).then(|| if is_unit { v } else { v.map(|x| x / length) })
}

fn from_columns(x: Vec3<f64>, y: Vec3<f64>, z: Vec3<f64>) -> Quat<f64> {
    shape::quat_of(&Mat3([[x[0], y[0], z[0]], [x[1], y[1], z[1]], [x[2], y[2], z[2]]]))
}

/// The shortest turn that takes z to the unit vector `to`.
pub(super) fn from_z(to: Vec3<f64>) -> Quat<f64> {
    let axis = Vec3([0.0, 0.0, 1.0]).cross(to);
    let sin = axis.norm();
    if sin < 1e-10 {
        // along z already, or turned over
        return if to[2] > 0.0 { Quat::IDENTITY } else { Quat([0.0, 1.0, 0.0, 0.0]) };
    }
    Quat::from_rotation_vector(axis * (sin.atan2(to[2]) / sin))
}
