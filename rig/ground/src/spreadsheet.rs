//! Tables as people have them: separated by commas, or as spreadsheets save them, by semicolons or tabs and with decimal commas; in UTF-8
//! or UTF-16; with lines of remarks that begin with `#`.

use csv::{ReaderBuilder, StringRecord, Trim};

/// A row with its line number, from 1.
pub type Row = (u64, StringRecord);

/// The rows of the table `text`, the header among them, blanks around cells taken off; they may be of different widths. Where cells
/// are not separated by commas, decimal commas become points.
///
/// # Errors
/// What is no table at all.
pub fn rows(text: &str) -> Result<Vec<Row>, csv::Error> {
    let text = text.strip_prefix(BYTE_ORDER_MARK).unwrap_or(text);
    let separator = separator(text);
    let mut reader = ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .trim(Trim::All)
        .comment(Some(b'#'))
        .delimiter(separator)
        .from_reader(text.as_bytes());
    let mut lines = Lines { text, at: 0, line: 1 };
    let mut row = |record: StringRecord| (lines.of(record.position().map_or(0, csv::Position::byte)), record);
    let rows: Vec<Row> = reader.records().map(|record| record.map(&mut row)).collect::<Result<_, _>>()?;
    match separator {
        b',' => Ok(rows),
        _ => Ok(with_decimal_points(rows)),
    }
}

const BYTE_ORDER_MARK: char = '\u{feff}';

/// Whether a line holds no row.
fn is_remark(line: &str) -> bool {
    line.trim().is_empty() || line.starts_with('#')
}

/// Numbers of lines, counted as editors do: the reader leaves out remarks, and what ends in two letters.
struct Lines<'a> {
    text: &'a str,
    at: usize,
    line: u64,
}

impl Lines<'_> {
    /// The line of the first row from `byte` on, which is no nearer to the beginning than the one before.
    fn of(&mut self, byte: u64) -> u64 {
        let to = usize::try_from(byte).unwrap_or(self.at).clamp(self.at, self.text.len());
        self.line += self.text.as_bytes()[self.at..to].iter().filter(|byte| **byte == b'\n').count() as u64;
        self.at = to;
        while let Some((line, rest)) = self.text.get(self.at..).and_then(|text| text.split_once('\n')) {
            if !is_remark(line) {
                break;
            }
            self.at = self.text.len() - rest.len();
            self.line += 1;
        }
        self.line
    }
}

/// What separates the cells of `text`: what its first line has, a comma if it has one.
fn separator(text: &str) -> u8 {
    let header = text.lines().find(|line| !is_remark(line)).unwrap_or_default();
    [b',', b';', b'\t'].into_iter().find(|&separator| header.contains(char::from(separator))).unwrap_or(b',')
}

/// `rows` with decimal points, if the commas in them are decimal ones: a table that has points in numbers too, or commas before three digits
/// only, may mean thousands, and stays as it is.
fn with_decimal_points(rows: Vec<Row>) -> Vec<Row> {
    let cells = || rows.iter().flat_map(|(_, row)| row.iter());
    let is_decimal = |cell: &str| !cell.contains('.') && cell.replacen(',', ".", 1).parse::<f64>().is_ok();
    let has_comma = |cell: &&str| cell.contains(',') && is_decimal(cell);
    let has_points = cells().any(|cell| cell.contains('.') && cell.parse::<f64>().is_ok());
    let may_be_thousands = |cell: &str| {
        cell.split_once(',')
            .is_some_and(|(before, after)| after.len() == 3 && before.trim_start_matches('-') != "0")
    };
    if has_points || cells().filter(has_comma).all(may_be_thousands) {
        return rows;
    }
    let pointed = |cell: &str| if is_decimal(cell) { cell.replacen(',', ".", 1) } else { cell.to_owned() };
    let mended = |(line, row): &Row| (*line, row.iter().map(pointed).collect());
    rows.iter().map(mended).collect()
}

/// The text that `bytes` are: UTF-8, or UTF-16 with its mark at the beginning, as spreadsheets save it.
///
/// # Errors
/// What they are not, and what to do.
pub fn decoded(bytes: Vec<u8>) -> Result<String, String> {
    let units = |from: fn([u8; 2]) -> u16| -> Vec<u16> {
        bytes[2..].chunks_exact(2).map(|pair| from([pair[0], pair[1]])).collect()
    };
    let wide = match bytes.get(..2) {
        Some([0xff, 0xfe]) => Some(units(u16::from_le_bytes)),
        Some([0xfe, 0xff]) => Some(units(u16::from_be_bytes)),
        _ => None,
    };
    if let Some(units) = wide {
        return String::from_utf16(&units)
            .map_err(|_| "begins as UTF-16 does and is not; save it as UTF-8".to_owned());
    }
    String::from_utf8(bytes).map_err(|error| {
        let (at, bytes) = (error.utf8_error().valid_up_to(), error.as_bytes());
        let line = bytes[..at].iter().filter(|byte| **byte == b'\n').count() + 1;
        match bytes.contains(&0) {
            true => "no text: is it the right file?".to_owned(),
            false => format!(
                "no UTF-8: byte 0x{:02X} in line {line} is that of a letter in Windows-1252 or Latin-1; save it as UTF-8",
                bytes[at]
            ),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(text: &str) -> Vec<(u64, Vec<String>)> {
        let all = rows(text).expect("a table");
        all.iter().map(|(line, row)| (*line, row.iter().map(str::to_owned).collect())).collect()
    }

    #[test]
    fn tables_of_spreadsheets_are_those_with_commas_and_points() {
        let wanted = cells("time_s,P1_x_m\n0.0,-0.02\n0.02,1e-3\n");
        for text in [
            "time_s;P1_x_m\n0,0;-0,02\n0,02;1e-3\n",
            "time_s\tP1_x_m\n0.0\t-0.02\n0.02\t1e-3\n",
            "\u{feff}time_s;P1_x_m\r\n0.0;-0.02\r\n0.02;1e-3\r\n",
        ] {
            assert_eq!(cells(text), wanted, "{text}");
        }
        let remarked = cells("# by a tool; with, marks\ntime_s,P1_x_m\n0.0,-0.02\n");
        assert_eq!(remarked[0], (2, vec!["time_s".to_owned(), "P1_x_m".to_owned()]));
    }

    #[test]
    fn commas_that_may_be_thousands_stay() {
        assert_eq!(cells("a;b\n1,234;12,000\n")[1].1, ["1,234", "12,000"]);
        assert_eq!(cells("a;b\n1,5;0.5\n")[1].1, ["1,5", "0.5"]);
        assert_eq!(cells("a;b\n1,234;0,5\n")[1].1, ["1.234", "0.5"]);
        assert_eq!(cells("a,b\n\"1,5\",2\n")[1].1, ["1,5", "2"]);
    }

    #[test]
    fn bytes_are_text_or_what_they_are_is_said() {
        assert_eq!(decoded("a µm".into()).expect("UTF-8"), "a µm");
        let wide: Vec<u8> =
            [0xff, 0xfe].into_iter().chain("a µm".encode_utf16().flat_map(u16::to_le_bytes)).collect();
        assert_eq!(decoded(wide).expect("UTF-16"), "a µm");
        let latin = decoded(b"a\n# 5 \xb5m\n".to_vec()).expect_err("no UTF-8");
        assert!(latin.contains("0xB5 in line 2") && latin.contains("Windows-1252"), "{latin}");
        assert!(decoded(b"\x89HDF\0\0".to_vec()).expect_err("no text").contains("right file"));
    }
}
