//! One element's attributes, its defaults included, checked and turned into numbers.

use std::collections::HashMap;

use roxmltree::Node;

use super::error::MjcfError;
use super::tables::table;
use crate::math::{Mat3, Quat, Vec3};
use crate::model::shape;

/// An attribute's text and the line it stands on.
pub(super) type Values<'a> = HashMap<&'a str, (&'a str, u32)>;

/// One element with all its attributes, those from its default classes too.
pub(super) struct Attributes<'a> {
    pub(super) tag: &'a str,
    pub(super) line: u32,
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
}

pub(super) fn line(node: Node<'_, '_>) -> u32 {
    node.document().text_pos_at(node.range().start).row
}

/// An element that is refused.
pub(super) fn refused(node: Node<'_, '_>) -> MjcfError {
    MjcfError::Element { line: line(node), element: node.tag_name().name().into() }
}

/// The node's own attributes, after a look at its table.
pub(super) fn checked<'a>(node: Node<'a, '_>) -> Result<Values<'a>, MjcfError> {
    let tag = node.tag_name().name();
    let table = table(tag).ok_or_else(|| refused(node))?;
    let mut values = Values::new();
    for attribute in node.attributes() {
        let (name, value) = (attribute.name(), attribute.value());
        let line = node.document().text_pos_at(attribute.range().start).row;
        if table.read.contains(&name) {
            values.insert(name, (value, line));
        } else if !table.passed_over.contains(&name) {
            let instead = match table.only.iter().find(|(known, _)| *known == name) {
                Some((_, allowed)) if allowed.iter().any(|allowed| same(allowed, value)) => continue,
                Some((_, allowed)) => format!("only \"{}\" is", allowed[0]),
                None => "remove it".into(),
            };
            return Err(MjcfError::Attribute {
                line,
                element: tag.into(),
                attribute: name.into(),
                value: value.into(),
                instead,
            });
        }
    }
    Ok(values)
}

/// Equal as numbers where both are, else as text.
fn same(a: &str, b: &str) -> bool {
    let numbers = |text: &str| text.split_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>();
    match (numbers(a), numbers(b)) {
        (Ok(a), Ok(b)) => a == b,
        _ => a == b,
    }
}

impl<'a> Attributes<'a> {
    /// The node's attributes over those of its default class.
    pub(super) fn new(node: Node<'a, '_>, defaults: Option<&Values<'a>>) -> Result<Self, MjcfError> {
        let mut values = defaults.cloned().unwrap_or_default();
        let own = checked(node)?;
        // pose and size can be given in several ways: the element's own way hides the defaults'
        const ORIENTATION: [&str; 5] = ["quat", "axisangle", "xyaxes", "zaxis", "euler"];
        if ORIENTATION.iter().any(|name| own.contains_key(name)) {
            values.retain(|name, _| !ORIENTATION.contains(name));
        }
        values.extend(own);
        Ok(Self { tag: node.tag_name().name(), line: line(node), values })
    }

    pub(super) fn text(&self, name: &str) -> Option<&'a str> {
        self.values.get(name).map(|(text, _)| *text)
    }

    pub(super) fn invalid(&self, name: &str, wanted: impl Into<String>) -> MjcfError {
        let (value, line) = self.values.get(name).copied().unwrap_or(("", self.line));
        MjcfError::Value {
            line,
            element: self.tag.into(),
            attribute: name.into(),
            value: value.into(),
            wanted: wanted.into(),
        }
    }

    pub(super) fn missing(&self, name: &str) -> MjcfError {
        MjcfError::Missing { line: self.line, element: self.tag.into(), attribute: name.into() }
    }

    pub(super) fn inconsistent(&self, name: &str, problem: impl Into<String>) -> MjcfError {
        MjcfError::Inconsistent {
            line: self.line,
            element: self.tag.into(),
            name: name.into(),
            problem: problem.into(),
        }
    }

    /// Between `least` and `most` finite numbers.
    pub(super) fn list(&self, name: &str, least: usize, most: usize) -> Result<Option<Vec<f64>>, MjcfError> {
        let Some(text) = self.text(name) else { return Ok(None) };
        let numbers: Option<Vec<f64>> =
            text.split_whitespace().map(|word| word.parse().ok().filter(|x: &f64| x.is_finite())).collect();
        match numbers {
            Some(numbers) if (least..=most).contains(&numbers.len()) => Ok(Some(numbers)),
            _ if least == most => Err(self.invalid(name, format!("{least} finite numbers"))),
            _ => Err(self.invalid(name, format!("{least} to {most} finite numbers"))),
        }
    }

    /// Exactly N finite numbers.
    pub(super) fn array<const N: usize>(&self, name: &str) -> Result<Option<[f64; N]>, MjcfError> {
        Ok(self.list(name, N, N)?.map(|numbers| std::array::from_fn(|i| numbers[i])))
    }

    /// Up to three finite numbers, the missing ones 0.
    pub(super) fn up_to_three(&self, name: &str) -> Result<[f64; 3], MjcfError> {
        let numbers = self.list(name, 1, 3)?.unwrap_or_default();
        Ok(std::array::from_fn(|i| numbers.get(i).copied().unwrap_or(0.0)))
    }

    /// Up to N finite numbers, the missing ones as in `usual`.
    pub(super) fn first_of<const N: usize>(
        &self,
        name: &str,
        usual: [f64; N],
    ) -> Result<[f64; N], MjcfError> {
        let numbers = self.list(name, 1, N)?.unwrap_or_default();
        Ok(std::array::from_fn(|i| numbers.get(i).copied().unwrap_or(usual[i])))
    }

    pub(super) fn vector(&self, name: &str) -> Result<Option<Vec3<f64>>, MjcfError> {
        Ok(self.array(name)?.map(Vec3))
    }

    pub(super) fn number(&self, name: &str, default: f64) -> Result<f64, MjcfError> {
        Ok(self.array(name)?.map_or(default, |[x]| x))
    }

    /// A finite number, not below 0.
    pub(super) fn not_negative(&self, name: &str, default: f64) -> Result<f64, MjcfError> {
        let x = self.number(name, default)?;
        if x < 0.0 { Err(self.invalid(name, "not below 0")) } else { Ok(x) }
    }

    /// Two rising numbers.
    pub(super) fn range(&self, name: &str) -> Result<Option<[f64; 2]>, MjcfError> {
        match self.array(name)? {
            // MuJoCo's way of saying there is none
            Some([0.0, 0.0]) | None => Ok(None),
            Some([low, high]) if low < high => Ok(Some([low, high])),
            Some(_) => Err(self.invalid(name, "two rising numbers")),
        }
    }

    /// One of several words.
    pub(super) fn one_of<T: Copy>(
        &self,
        name: &str,
        words: &[(&str, T)],
        default: T,
    ) -> Result<T, MjcfError> {
        let Some(text) = self.text(name) else { return Ok(default) };
        words.iter().find(|(word, _)| *word == text).map(|(_, value)| *value).ok_or_else(|| {
            let known: Vec<_> = words.iter().map(|(word, _)| *word).collect();
            self.invalid(name, format!("one of: {}", known.join(", ")))
        })
    }

    /// The range of `range_name` where it applies: as `limited_name` says, or by its being there.
    pub(super) fn limited_range(
        &self,
        range_name: &str,
        limited_name: &str,
        autolimits: bool,
    ) -> Result<Option<[f64; 2]>, MjcfError> {
        let range = self.range(range_name)?;
        let limited =
            self.one_of(limited_name, &[("true", Some(true)), ("false", Some(false)), ("auto", None)], None)?;
        match limited {
            Some(true) if range.is_none() => Err(self.missing(range_name)),
            Some(true) => Ok(range),
            Some(false) => Ok(None),
            None if !autolimits && range.is_some() => Err(self.inconsistent(
                self.text("name").unwrap_or(""),
                format!("has a {range_name} but does not say {limited_name}, and autolimits is off"),
            )),
            None => Ok(range),
        }
    }

    /// `parent_from_child` from whichever of the five forms is given.
    pub(super) fn orientation(&self, angles: &Angles) -> Result<Quat<f64>, MjcfError> {
        let given: Vec<_> = ["quat", "axisangle", "xyaxes", "zaxis", "euler"]
            .into_iter()
            .filter(|name| self.text(name).is_some())
            .collect();
        let [name] = given[..] else {
            return match given.first() {
                None => Ok(Quat::IDENTITY),
                Some(_) => Err(self.invalid(given[1], format!("absent beside {}", given[0]))),
            };
        };
        let unit = |v: Vec3<f64>| {
            let norm = v.norm();
            if norm > 1e-14 { Ok(v * (1.0 / norm)) } else { Err(self.invalid(name, "of nonzero length")) }
        };
        match name {
            "quat" => {
                let q = self.array::<4>(name)?.unwrap_or([1.0, 0.0, 0.0, 0.0]);
                if q.iter().all(|c| c.abs() < 1e-14) {
                    return Err(self.invalid(name, "of nonzero length"));
                }
                Ok(Quat(q).normalized())
            }
            "axisangle" => {
                let [x, y, z, angle] = self.array::<4>(name)?.unwrap_or_default();
                Ok(Quat::from_rotation_vector(unit(Vec3([x, y, z]))? * angles.radians(angle)))
            }
            "xyaxes" => {
                let [a, b, c, d, e, f] = self.array::<6>(name)?.unwrap_or_default();
                let x = unit(Vec3([a, b, c]))?;
                let y = Vec3([d, e, f]);
                let y = unit(y - x * x.dot(y))?;
                Ok(from_columns(x, y, x.cross(y)))
            }
            "zaxis" => Ok(from_z(unit(self.vector(name)?.unwrap_or(Vec3::ZERO))?)),
            _ => {
                let turns = self.array::<3>(name)?.unwrap_or_default();
                let mut q = Quat::IDENTITY;
                for (letter, turn) in angles.euler_sequence.chars().zip(turns) {
                    let axis = match letter.to_ascii_lowercase() {
                        'x' => [1.0, 0.0, 0.0],
                        'y' => [0.0, 1.0, 0.0],
                        _ => [0.0, 0.0, 1.0],
                    };
                    let by = Quat::from_rotation_vector(Vec3(axis) * angles.radians(turn));
                    // lower case turns with the body, upper case about fixed axes
                    q = if letter.is_ascii_lowercase() { q.product(by) } else { by.product(q) };
                }
                Ok(q)
            }
        }
    }
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
