//! Units as WCON writes them: `mm`, `millimetres`, `0.04*s`, `in/72`.

/// What a unit measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Metres.
    Length,
    /// Seconds.
    Time,
}

/// Short names, which take [`PREFIXES`]' short forms.
const SHORT_UNIT_NAMES: [(&str, f64, Kind); 10] = [
    ("s", 1.0, Kind::Time),
    ("sec", 1.0, Kind::Time),
    ("min", 60.0, Kind::Time),
    ("h", 3600.0, Kind::Time),
    ("hr", 3600.0, Kind::Time),
    ("d", 86400.0, Kind::Time),
    ("m", 1.0, Kind::Length),
    ("in", 0.0254, Kind::Length),
    ("ft", 0.3048, Kind::Length),
    ("micron", 1e-6, Kind::Length),
];
/// Names in full, singular and without prefix.
const FULL_UNIT_NAMES: [(&str, f64, Kind); 9] = [
    ("second", 1.0, Kind::Time),
    ("minute", 60.0, Kind::Time),
    ("hour", 3600.0, Kind::Time),
    ("day", 86400.0, Kind::Time),
    ("metre", 1.0, Kind::Length),
    ("meter", 1.0, Kind::Length),
    ("inch", 0.0254, Kind::Length),
    ("foot", 0.3048, Kind::Length),
    ("micron", 1e-6, Kind::Length),
];
/// In full and short.
const PREFIXES: [(&str, &[&str], f64); 7] = [
    ("centi", &["c"], 1e-2),
    ("milli", &["m"], 1e-3),
    ("micro", &["u", "\u{b5}", "\u{3bc}"], 1e-6),
    ("nano", &["n"], 1e-9),
    ("kilo", &["k", "K"], 1e3),
    ("mega", &["M"], 1e6),
    ("giga", &["G"], 1e9),
];

/// How many metres or seconds one of `text` is; none where it is no unit of that kind.
pub(super) fn factor(text: &str, wanted: Kind) -> Option<f64> {
    let (mut value, mut power) = (1.0, 0);
    let mut rest = text.trim();
    let mut divides = false;
    loop {
        let end = rest.find(['*', '/']).unwrap_or(rest.len());
        let (term, after) = rest.split_at(end);
        let (size, kind) = match term.trim().parse::<f64>() {
            Ok(number) => (number, None),
            Err(_) => named(term.trim()).map(|(size, kind)| (size, Some(kind)))?,
        };
        value = if divides { value / size } else { value * size };
        match kind {
            Some(kind) if kind == wanted => power += if divides { -1 } else { 1 },
            Some(_) => return None,
            None => {}
        }
        let Some(operator) = after.chars().next() else { break };
        divides = operator == '/';
        rest = &after[1..];
    }
    (power == 1 && value.is_finite() && value > 0.0).then_some(value)
}

fn named(name: &str) -> Option<(f64, Kind)> {
    let short = |name: &str| SHORT_UNIT_NAMES.iter().find(|(known, ..)| *known == name);
    let full = |name: &str| {
        let singular = match name {
            "feet" => "foot",
            "inches" => "inch",
            _ => name.strip_suffix('s').unwrap_or(name),
        };
        FULL_UNIT_NAMES.iter().find(|(known, ..)| *known == singular)
    };
    if let Some((_, size, kind)) = short(name).or_else(|| full(name)) {
        return Some((*size, *kind));
    }
    PREFIXES.iter().find_map(|(in_full, letters, times)| {
        let long = name.strip_prefix(in_full).and_then(full);
        let brief = || letters.iter().find_map(|letter| name.strip_prefix(letter).and_then(short));
        long.or_else(brief).map(|(_, size, kind)| (size * times, *kind))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_as_the_format_writes_them() {
        for (text, kind, wanted) in [
            ("mm", Kind::Length, 1e-3),
            ("millimetres", Kind::Length, 1e-3),
            ("\u{3bc}m", Kind::Length, 1e-6),
            ("microns", Kind::Length, 1e-6),
            ("12*in", Kind::Length, 0.3048),
            ("in/72", Kind::Length, 0.0254 / 72.0),
            ("feet", Kind::Length, 0.3048),
            ("Mm", Kind::Length, 1e6),
            ("s", Kind::Time, 1.0),
            ("ms", Kind::Time, 1e-3),
            ("min", Kind::Time, 60.0),
            ("0.04 * s", Kind::Time, 0.04),
            ("seconds", Kind::Time, 1.0),
        ] {
            let found = factor(text, kind).unwrap_or_else(|| panic!("{text}"));
            assert!((found / wanted - 1.0).abs() < 1e-12, "{text}: {found}");
        }
    }

    #[test]
    fn what_is_no_such_unit_is_none() {
        for text in
            ["", "1", "px", "pixels", "mm/s", "mm*mm", "1/mm", "-1*mm", "0*mm", "msecond", "nan*mm", "mm*"]
        {
            assert_eq!(factor(text, Kind::Length), None, "{text}");
        }
        assert_eq!(factor("mm", Kind::Time), None);
    }
}
