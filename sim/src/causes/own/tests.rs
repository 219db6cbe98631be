//! Expressions as they are read and worked out, and what is refused.
#![allow(clippy::unwrap_used, reason = "tests")]

use super::parse::{Scope, Stumble, parse};
use super::program::{VARIABLES, Variable};
use super::{Acts, OwnCause, OwnCauseError, OwnParameter, Place};
use crate::dual::Dual;
use crate::model::Model;
use crate::scalar::Scalar;

/// A few roundings, and the exponential's own error.
const ROUNDING: f64 = 1e-12;
const Q: f64 = 0.7;
const V: f64 = -1.3;
const K: f64 = 2.5;

fn read(text: &str) -> Result<super::Program, Stumble> {
    let parameters = ["k".to_owned(), "size".to_owned()];
    let lacking = |variable: Variable| format!("no {} here", variable.name());
    let variables = [Variable::Q, Variable::V, Variable::T];
    parse(text, &Scope { variables: &variables, lacking: &lacking, parameters: &parameters })
}

fn value<T: Scalar>(text: &str, q: T, v: T, k: T) -> T {
    let mut values = [T::ZERO; VARIABLES];
    values[Variable::Q as usize] = q;
    values[Variable::V as usize] = v;
    read(text).unwrap().value(&values, &[k, T::ONE])
}

fn at(text: &str) -> f64 {
    value(text, Q, V, K)
}

#[test]
fn operators_bind_as_in_mathematics() {
    let cases = [
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("10 - 4 - 3", 3.0),
        ("24 / 4 / 3", 2.0),
        ("2 * 3 ^ 2", 18.0),
        ("-3 ^ 2", -9.0),
        ("(-3) ^ 2", 9.0),
        ("2 ^ 3 ^ 2", 512.0),
        ("2 ^ -1 * 6", 3.0),
        ("--2", 2.0),
        ("3 - -2", 5.0),
        ("-2 * -3", 6.0),
        ("+.5e1 - 1.", 4.0),
        ("1e-3 * 2E+3", 2.0),
        ("6 / -2 + 1", -2.0),
        ("5 ^ 0", 1.0),
    ];
    for (text, expected) in cases {
        assert_eq!(at(text), expected, "{text}");
    }
}

#[test]
fn functions_are_those_of_the_library() {
    let cases = [
        ("sin(8 * q)", (8.0 * Q).sin()),
        ("cos(v) - pi", V.cos() - std::f64::consts::PI),
        ("tan(q)", Q.tan()),
        ("exp(-q * k)", (-Q * K).exp()),
        ("log(k)", K.ln()),
        ("sqrt(k + 1)", (K + 1.0).sqrt()),
        ("k ^ 0.5", K.sqrt()),
        ("abs(v) ^ 1.5", 1.3_f64.powf(1.5)),
        ("k ^ q", K.powf(Q)),
        ("v ^ 5 + v ^ -3", V.powi(5) + V.powi(-3)),
        ("sign(v) * sign(q) + sign(t)", -1.0),
        ("tanh(v / 0.02) + tanh(0.1) + tanh(0.2)", -1.0 + 0.1_f64.tanh() + 0.2_f64.tanh()),
        ("min(q, v) * max(q, k)", V * K),
        ("atan2(v, q)", V.atan2(Q)),
        ("v * abs(v) * k", V * V.abs() * K),
    ];
    for (text, expected) in cases {
        let ours = at(text);
        assert!((ours - expected).abs() < ROUNDING * (1.0 + expected.abs()), "{text}: {ours} {expected}");
    }
    // where quotients of exponentials lose their digits
    for q in [1e-9, 1e-3, 0.149, 0.151, 3.0, 30.0] {
        let ours = value("tanh(q)", q, 0.0, 0.0);
        assert!((ours / f64::tanh(q) - 1.0).abs() < 1e-13, "{q}: {ours}");
    }
}

#[test]
fn derivatives_agree_with_central_differences() {
    type One = Dual<f64, 1>;
    let texts = [
        "-k * sin(8 * q)",
        "v / sqrt(v ^ 2 + 0.05 ^ 2)",
        "k * abs(v) ^ 1.7 * sign(v)",
        "exp(-(q - 1) ^ 2) * tan(q) + log(q) * cos(v)",
        "tanh(q / 3) + tanh(q / 9) - atan2(v, q) ^ 3",
        "min(q, v ^ 2) * max(q, 0.1) / (1 + q ^ 4)",
        "q ^ q + q ^ -2",
    ];
    let step = 1e-6;
    for text in texts {
        for along in 0..3 {
            let at = |k: usize, x: f64| if k == along { One::variable(x, 0) } else { One::constant(x) };
            let exact = value(text, at(0, Q), at(1, V), at(2, K)).partials[0];
            let moved = |by: f64| {
                let [q, v, k] = std::array::from_fn(|i| [Q, V, K][i] + if i == along { by } else { 0.0 });
                value(text, q, v, k)
            };
            let difference = (moved(step) - moved(-step)) / (2.0 * step);
            assert!((exact - difference).abs() < 1e-8 * (1.0 + exact.abs()), "{text}: {exact} {difference}");
        }
    }
}

/// The part of `text` that is meant, and why.
fn stumble(text: &str) -> (String, String) {
    let stumble = read(text).unwrap_err();
    let meant = text.chars().skip(stumble.at).take(stumble.width).collect();
    let known = stumble.unknown.map_or(String::new(), |(_, known)| format!(" [{}]", known.join(" ")));
    (meant, stumble.reason + &known)
}

#[test]
fn what_is_not_understood_is_shown_where_it_stands() {
    let cases = [
        ("-siz * sin(q)", "siz", "there is no number called `siz` [k size q v t pi]"),
        ("-size * sn(q)", "sn", "there is no function called `sn` [sin cos"),
        ("2 q", "q", "an operator is missing before `q`"),
        ("2(q + 1)", "(", "an operator is missing before `(`"),
        ("(q + 1) (q)", "(", "an operator is missing before `(`"),
        ("size * (q + v", "(", "this `(` is never closed"),
        ("size * q)", ")", "a `)` without its `(`"),
        ("size * ", "", "it ends where a number"),
        ("  ", "", "it is empty"),
        ("size * * q", "*", "a number, a name or a `(` should stand here, not `*`"),
        ("size ** 2", "**", "a power is written `^`"),
        ("size · q", "·", "a product is written `*`"),
        ("−size", "−", "a minus is written `-`"),
        ("size $ q", "$", "`$` means nothing here"),
        ("1.2.3 * q", ".3", "an operator is missing before `.3`"),
        (". * q", ".", "`.` is no number"),
        ("sin", "sin", "the function `sin` needs a `(` after it"),
        ("size(q)", "size", "`size` is no function"),
        ("sin(q, v)", ",", "`sin` takes one number"),
        ("min(q)", ")", "`min` takes two numbers"),
        ("max(q, v, t)", ",", "`max` takes two numbers"),
        ("q, v", ",", "a comma outside of a function"),
        ("command * size", "command", "no command here"),
        ("sin()", ")", "a number, a name or a `(` should stand here, not `)`"),
    ];
    for (text, meant, reason) in cases {
        let (ours, why) = stumble(text);
        assert_eq!(ours, meant, "{text}: {why}");
        assert!(why.starts_with(reason), "{text}: {why}");
    }
    let deep = format!("{}q{}", "(".repeat(300), ")".repeat(300));
    assert!(stumble(&deep).1.contains("nested deeper"));
    let waiting = format!("{}q{}", "1 + q * (".repeat(20), ")".repeat(20));
    assert!(stumble(&waiting).1.contains("numbers wait"), "{:?}", stumble(&waiting));
    assert!(stumble(&"q + ".repeat(400)).1.contains("the limit is"));
}

fn chain() -> Model {
    Model::from_mjcf(include_str!("../../../tests/data/chain_active.xml")).unwrap()
}

fn cause(place: Place, terms: &[(Acts, &str)], parameters: &[OwnParameter]) -> OwnCause {
    OwnCause {
        name: "detent".into(),
        sentence: None,
        place,
        terms: terms.iter().map(|(acts, text)| (*acts, (*text).to_owned())).collect(),
        parameters: parameters.to_vec(),
    }
}

fn size(name: &str) -> OwnParameter {
    OwnParameter::size(name, "N m", [-1e-2, 1e-2], 1e-5)
}

fn hidden(name: &str, bounds: [f64; 2], starts: &[f64]) -> OwnParameter {
    OwnParameter { hidden: starts.to_vec(), ..OwnParameter::size(name, "1", bounds, 0.1 * bounds[1]) }
}

fn torque(joint: &str, text: &str, parameters: &[OwnParameter]) -> OwnCause {
    cause(Place::Joint(joint.into()), &[(Acts::Torque, text)], parameters)
}

fn refusal(definition: &OwnCause) -> OwnCauseError {
    chain().define_cause(definition).unwrap_err()
}

#[test]
fn a_cause_that_is_not_absent_at_size_0_is_refused_with_the_reason() {
    let sized = [size("size")];
    let cases = [
        ("-size * sin(8 * q) + 1e-6", "it must vanish there"),
        ("1e-6 * cos(size * q)", "it must vanish there"),
        ("size ^ 2 * q", "changes nothing to first order at 0"),
        ("size * v / abs(v)", "is no finite number at v = 0.000, size = 0"),
        ("size * sqrt(v)", "is no finite number at v = "),
        ("size * log(abs(v))", "has no finite slope by `v` at v = 0.000"),
        ("size * 1e300 ^ 2", "is no finite number"),
    ];
    for (text, reason) in cases {
        let error = refusal(&torque("q2", text, &sized));
        assert!(error.reason.contains(reason) && error.cause == "detent", "{text}: {error}");
    }
    // another number that makes it vanish is no size, and a size that is not one is no parameter
    let other = refusal(&torque("q2", "size * shape * q", &[size("size"), size("shape")]));
    assert!(other.reason.contains("`size` changes nothing to first order"), "{other}");
    let fixed = torque("q2", "size * q", &[size("size"), hidden("shape", [0.1, 1.0], &[0.5])]);
    assert!(refusal(&fixed).reason.contains("stands in no expression"));
    let none = torque("q2", "shape * q", &[hidden("shape", [0.1, 1.0], &[0.5])]);
    assert!(refusal(&none).reason.contains("needs a size"));
}

#[test]
fn names_that_are_taken_or_unknown_are_refused_by_name() {
    let sized = [size("size")];
    let good = || torque("q2", "-size * sin(8 * q)", &sized);
    let called = |name: &str| refusal(&OwnCause { name: name.into(), ..good() }).to_string();
    assert!(called("wall").contains("a known cause is called that"));
    assert!(called("q2").contains("an element of the model is called that"));
    assert!(called("my detent").contains("letters, digits and `_`"));
    let mut twice = chain();
    twice.define_cause(&good()).unwrap();
    assert!(twice.define_cause(&good()).unwrap_err().reason.contains("two of that name"));

    let elsewhere = refusal(&torque("q4", "-size * q", &sized));
    assert_eq!((elsewhere.text.as_str(), elsewhere.meant), ("q4", (0, 2)));
    assert_eq!(elsewhere.unknown, Some(("q4".into(), vec!["q1".into(), "q2".into(), "q3".into()])));
    assert!(
        refusal(&torque("q2", "-size * command", &sized))
            .reason
            .contains("no actuator drives the joint `q2`")
    );
    assert!(chain().define_cause(&torque("q1", "-size * (q - command)", &sized)).is_ok());
    assert!(refusal(&torque("q2", "-size * vx", &sized)).reason.contains("`vx` is not known at joint `q2`"));
    assert!(refusal(&torque("q2", "-v * q", &[size("v")])).reason.contains("choose another name"));
    assert!(refusal(&torque("q2", "-pi * q", &[size("pi")])).reason.contains("choose another name"));

    let keypoint = |text| cause(Place::Keypoint("P2".into()), &[(Acts::Shift(0), text)], &sized);
    assert!(chain().define_cause(&keypoint("size * sin(20 * z)")).is_ok());
    assert!(
        refusal(&keypoint("size * vx")).reason.contains("a picture shows where a keypoint is, not how fast")
    );
    let misplaced = cause(Place::Joint("q2".into()), &[(Acts::Force(0), "size")], &sized);
    assert!(refusal(&misplaced).reason.contains("`force_x` does not go with joint `q2`"));
    assert!(refusal(&cause(Place::Joint("q2".into()), &[], &sized)).reason.contains("add `torque"));
    let bounds = OwnParameter { bounds: [1.0, 2.0], typical: 1.5, ..size("size") };
    assert!(refusal(&torque("q2", "size * q", &[bounds])).reason.contains("must lie within the bounds"));
}

#[test]
fn what_is_written_the_same_is_one_cause_and_what_is_not_is_another() {
    let define = |text: &str| chain().define_cause(&torque("q2", text, &[size("size")])).unwrap();
    assert_eq!(define("-size * q"), define("-size * q"));
    assert_ne!(define("-size * q"), define("-size * v"));
    let message = format!("{:?}", define("-size * q"));
    assert!(message.contains("torque = -size * q at joint `q2`"), "{message}");
}
