//! What goes into a graph and what comes out: tensors are matched by name, never by place.

use std::fmt;

/// A tensor as a graph declares it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tensor {
    /// Name.
    pub name: String,
    /// Element type.
    pub kind: String,
    /// Sizes, the slowest first; -1 is any. Empty: the graph does not say.
    pub shape: Vec<i64>,
}

/// 32 bit floating point.
pub(super) const F32: &str = "float32";
/// 64 bit integers.
pub(super) const I64: &str = "int64";

/// A tensor that a graph should have.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted {
    /// What exports call it, the usual name first: by that it is known here.
    pub(super) names: &'static [&'static str],
    /// Any of these element types.
    pub(super) kinds: &'static [&'static str],
    /// Any of these shapes; sizes of -1 are any.
    pub(super) shapes: &'static [&'static [i64]],
    pub(super) optional: bool,
}

/// The tensors of one graph.
#[derive(Debug, Clone, Copy)]
pub(super) struct Signature {
    pub(super) inputs: &'static [Wanted],
    pub(super) outputs: &'static [Wanted],
}

/// A wanted tensor and what the graph calls it.
pub(super) type Bound = Vec<(&'static str, Tensor)>;

/// How a graph differs from what is wanted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Mismatch {
    /// A tensor is not there.
    Missing {
        /// "input" or "output".
        way: &'static str,
        /// Its names.
        names: Vec<&'static str>,
        /// What is there.
        found: Vec<String>,
    },
    /// It is another one.
    Other {
        /// "input" or "output".
        way: &'static str,
        /// Its name.
        name: String,
        /// What was expected.
        expected: String,
        /// What was found.
        found: String,
    },
    /// The graph wants something that nobody knows.
    Unknown {
        /// Its name and shape.
        name: String,
    },
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing { way, names, found } => {
                write!(f, "no {way} `{}`, but {}", names.join("` or `"), found.join(", "))
            }
            Self::Other { way, name, expected, found } => {
                write!(f, "its {way} `{name}` is expected to be {expected}, found {found}")
            }
            Self::Unknown { name } => write!(f, "it asks for the unknown input `{name}`"),
        }
    }
}

/// A tensor that must be there.
pub(super) const fn wanted(
    names: &'static [&'static str],
    kinds: &'static [&'static str],
    shapes: &'static [&'static [i64]],
) -> Wanted {
    Wanted { names, kinds, shapes, optional: false }
}

/// A tensor that may be there.
pub(super) const fn optional(
    names: &'static [&'static str],
    kinds: &'static [&'static str],
    shapes: &'static [&'static [i64]],
) -> Wanted {
    Wanted { names, kinds, shapes, optional: true }
}

impl Signature {
    /// What a graph of these tensors calls those that are wanted, inputs and outputs; its further outputs are not asked for.
    pub(super) fn bound(&self, inputs: &[Tensor], outputs: &[Tensor]) -> Result<[Bound; 2], Mismatch> {
        let bound = [matched("input", self.inputs, inputs)?, matched("output", self.outputs, outputs)?];
        let known = |tensor: &Tensor| bound[0].iter().any(|(_, known)| known.name == tensor.name);
        match inputs.iter().find(|tensor| !known(tensor)) {
            Some(tensor) => Err(Mismatch::Unknown { name: tensor.name.clone() }),
            None => Ok(bound),
        }
    }
}

fn matched(way: &'static str, wanted: &[Wanted], found: &[Tensor]) -> Result<Bound, Mismatch> {
    let mut bound = Bound::new();
    for wanted in wanted {
        match found.iter().find(|tensor| wanted.names.contains(&tensor.name.as_str())) {
            Some(tensor) => {
                wanted.check(way, tensor)?;
                bound.push((wanted.names[0], tensor.clone()));
            }
            None if wanted.optional => {}
            None => {
                let found = found.iter().map(|tensor| tensor.name.clone()).collect();
                return Err(Mismatch::Missing { way, names: wanted.names.into(), found });
            }
        }
    }
    Ok(bound)
}

impl Wanted {
    /// Whether `tensor` may be it.
    pub(super) fn check(&self, way: &'static str, tensor: &Tensor) -> Result<(), Mismatch> {
        let fits = |shape: &&[i64]| {
            shape.len() == tensor.shape.len()
                && shape.iter().zip(&tensor.shape).all(|(a, b)| *a == -1 || *b == -1 || a == b)
        };
        let kind = self.kinds.contains(&tensor.kind.as_str());
        if kind && (tensor.shape.is_empty() || self.shapes.iter().any(fits)) {
            return Ok(());
        }
        let shapes: Vec<String> = self.shapes.iter().map(|shape| sizes(shape)).collect();
        Err(Mismatch::Other {
            way,
            name: tensor.name.clone(),
            expected: format!("{} {}", self.kinds.join(" or "), shapes.join(" or ")),
            found: format!("{} {}", tensor.kind, sizes(&tensor.shape)),
        })
    }
}

fn sizes(shape: &[i64]) -> String {
    let sizes = shape.iter().map(|size| if *size < 0 { "any".to_owned() } else { size.to_string() });
    format!("[{}]", sizes.collect::<Vec<_>>().join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIGNATURE: Signature = Signature {
        inputs: &[
            wanted(&["image", "input"], &[F32], &[&[1, 3, 8, 8]]),
            optional(&["frame_size"], &[I64], &[&[2]]),
        ],
        outputs: &[wanted(&["code"], &[F32], &[&[7, 1, 64], &[7, 64]])],
    };

    fn tensor(name: &str, kind: &str, shape: &[i64]) -> Tensor {
        Tensor { name: name.into(), kind: kind.into(), shape: shape.into() }
    }

    #[test]
    fn tensors_are_matched_by_any_of_their_names_in_any_order() {
        let inputs = [tensor("frame_size", I64, &[2]), tensor("input", F32, &[-1, 3, 8, 8])];
        let outputs = [tensor("more", F32, &[1]), tensor("code", F32, &[7, 64])];
        let [inputs, outputs] = SIGNATURE.bound(&inputs, &outputs).unwrap();
        let names = |bound: &Bound| -> Vec<(&str, String)> {
            bound.iter().map(|(key, tensor)| (*key, tensor.name.clone())).collect()
        };
        assert_eq!(names(&inputs), [("image", "input".into()), ("frame_size", "frame_size".into())]);
        assert_eq!(names(&outputs), [("code", "code".into())]);
        let few = [tensor("image", F32, &[1, 3, 8, 8])];
        assert_eq!(SIGNATURE.bound(&few, &[tensor("code", F32, &[7, 1, 64])]).unwrap()[0].len(), 1);
    }

    #[test]
    fn a_wrong_tensor_is_told_with_what_was_expected_and_found() {
        let (image, code) = (tensor("image", F32, &[1, 3, 8, 8]), tensor("code", F32, &[7, 64]));
        let told = |inputs: &[Tensor], outputs: &[Tensor]| {
            SIGNATURE.bound(inputs, outputs).expect_err("a mismatch").to_string()
        };
        let small = tensor("image", F32, &[1, 3, 4, -1]);
        assert_eq!(
            told(&[small], std::slice::from_ref(&code)),
            "its input `image` is expected to be float32 [1, 3, 8, 8], found float32 [1, 3, 4, any]"
        );
        let whole = tensor("code", I64, &[7, 64]);
        assert_eq!(
            told(std::slice::from_ref(&image), &[whole]),
            "its output `code` is expected to be float32 [7, 1, 64] or [7, 64], found int64 [7, 64]"
        );
        let other = tensor("pixels", F32, &[1]);
        assert_eq!(
            told(std::slice::from_ref(&other), std::slice::from_ref(&code)),
            "no input `image` or `input`, but pixels"
        );
        assert_eq!(told(&[image, other], &[code]), "it asks for the unknown input `pixels`");
    }
}
