//! Numbers in sentences.

/// `metres` in millimetres: two decimals, and where these would say little, two significant digits; nothing below a
/// nanometre.
#[must_use]
pub fn millimetres(metres: f64) -> String {
    let value = metres * 1e3;
    let size = value.abs();
    if !(1e-6..0.1).contains(&size) {
        return format!("{value:.2}");
    }
    let decimals = (1.0 - size.log10().floor()).max(2.0) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::millimetres;

    #[test]
    fn millimetres_keep_two_digits_however_small() {
        let all = [0.0123, 1.234e-3, 1e-4, 9.7e-5, 4.4e-5, 1.3e-6, 9.9e-10, 0.0];
        let read = all.map(millimetres);
        assert_eq!(read, ["12.30", "1.23", "0.10", "0.097", "0.044", "0.0013", "0.00", "0.00"]);
        assert_eq!(millimetres(f64::NAN), "NaN");
    }
}
