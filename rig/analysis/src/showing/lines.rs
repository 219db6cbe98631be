//! Reads snapshots from the socket: one JSON object per line.

/// A longer line is refused \[bytes\]. Chosen.
const LINE_LIMIT_BYTES: usize = 4 << 20;

/// A line is longer than any snapshot can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("more than {LINE_LIMIT_BYTES} bytes without the end of a line")]
pub struct TooLong;

/// Joins the pieces that were read into whole lines.
#[derive(Debug, Default)]
pub struct Lines {
    partial: Vec<u8>,
}

impl Lines {
    /// Adds what was `read`, and returns the newest whole line, without its line feed; older lines are skipped.
    ///
    /// # Errors
    /// [`TooLong`].
    pub fn newest(&mut self, read: &[u8]) -> Result<Option<String>, TooLong> {
        let before = self.partial.len();
        self.partial.extend_from_slice(read);
        let end = self.partial[before..].iter().rposition(|&byte| byte == b'\n').map(|end| before + end);
        let Some(end) = end else {
            return if self.partial.len() > LINE_LIMIT_BYTES { Err(TooLong) } else { Ok(None) };
        };
        let left = self.partial.split_off(end + 1);
        let whole = std::mem::replace(&mut self.partial, left);
        let begin = whole[..end].iter().rposition(|&byte| byte == b'\n').map_or(0, |begin| begin + 1);
        Ok(Some(String::from_utf8_lossy(&whole[begin..end]).into_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn newest_whole_line_comes_out_however_it_was_cut() {
        let text = "{\"a\":1}\n{\"b\":\"ö\"}\n{}\n";
        for cut in 1..text.len() {
            let mut lines = Lines::default();
            let mut came = Vec::new();
            for piece in text.as_bytes().chunks(cut) {
                came.extend(lines.newest(piece).unwrap());
            }
            assert_eq!(came.last().map(String::as_str), Some("{}"), "{cut}");
            assert!(came.iter().all(|line| text.contains(&format!("{line}\n"))), "{cut}: {came:?}");
        }
        let mut lines = Lines::default();
        assert_eq!(
            lines.newest(text.as_bytes()).unwrap().as_deref(),
            Some("{}"),
            "older ones are passed over"
        );
        assert_eq!(lines.newest(b"{").unwrap(), None);
    }

    #[test]
    fn line_without_an_end_is_given_up() {
        let mut lines = Lines::default();
        let piece = vec![b'x'; 1 << 20];
        let came: Vec<_> = (0..5).map(|_| lines.newest(&piece)).collect();
        assert_eq!(came, [Ok(None), Ok(None), Ok(None), Ok(None), Err(TooLong)]);
    }
}
