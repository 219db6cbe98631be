//! Numbers as people read them.

pub(super) use ident::millimetres;

/// A share in whole percent.
pub(super) fn whole_percent(share: f64) -> String {
    format!("{}", (100.0 * share).round() as i64)
}

/// Percent of a length with one decimal; a dash without a length.
pub(super) fn percent(part: f64, whole: f64) -> String {
    if whole > 0.0 { format!("{:.1}", part / whole * 100.0) } else { "–".into() }
}

/// Three significant digits, in exponent form where plain digits would be hard to read.
pub(super) fn significant(value: f64) -> String {
    if !value.is_finite() {
        return "–".into();
    }
    if value == 0.0 {
        return "0".into();
    }
    let exponent = value.abs().log10().floor() as i32;
    if (-3..5).contains(&exponent) {
        let decimals = usize::try_from(2 - exponent).unwrap_or(0);
        format!("{value:.decimals$}")
    } else {
        let text = format!("{value:.2e}");
        match text.split_once('e') {
            Some((mantissa, power)) => format!("{mantissa}·10{}", superscript(power)),
            None => text,
        }
    }
}

fn superscript(power: &str) -> String {
    power
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            '4'..='9' => char::from_u32('⁰' as u32 + (c as u32 - '0' as u32)).unwrap_or(c),
            _ => '⁰',
        })
        .collect()
}

/// A duration in the unit that suits it.
pub(super) fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 0.001 => format!("{:.0} µs", s * 1e6),
        s if s < 1.0 => format!("{:.0} ms", s * 1e3),
        s if s < 100.0 => format!("{s:.1} s"),
        s => format!("{:.0} min {:.0} s", (s / 60.0).floor(), s % 60.0),
    }
}

/// "1 image", "2 images".
pub(super) fn counted(count: usize, what: &str) -> String {
    if count == 1 { format!("1 {what}") } else { format!("{count} {what}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_three_digits_over_many_magnitudes() {
        let texts = [0.0, 1.5, 0.0123456, 123.456, 2.0e-6, -4.5e-12, 1.2345e7].map(significant);
        assert_eq!(texts, ["0", "1.50", "0.0123", "123", "2.00·10⁻⁶", "-4.50·10⁻¹²", "1.23·10⁷"]);
        assert_eq!(significant(f64::NAN), "–");
    }

    #[test]
    fn durations_choose_their_unit() {
        assert_eq!([4e-5, 0.25, 12.34, 125.0].map(duration), ["40 µs", "250 ms", "12.3 s", "2 min 5 s"]);
    }
}
