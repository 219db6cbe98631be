//! Grouping of reasons: texts that differ in their numbers only count as one.

/// Reasons of a list that differ in their numbers only.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReasonGroup {
    /// Their common text; a number that differs is written as the range it spans, `3.2 to 12`.
    pub text: String,
    /// Indices of the members in the list, rising.
    pub members: Vec<usize>,
}

/// Groups `reasons` that differ in their numbers only, the most frequent first, equally frequent ones in the order in which they
/// came. A number that belongs to a name (`P2`, `g1`) makes reasons different.
pub fn told_together<'a>(reasons: impl IntoIterator<Item = &'a str>) -> Vec<ReasonGroup> {
    let mut kinds: Vec<(Kind, Vec<usize>)> = Vec::new();
    for (place, reason) in reasons.into_iter().enumerate() {
        let kind = Kind::of(reason);
        match kinds.iter_mut().find(|(known, _)| known.words == kind.words) {
            Some((known, members)) => {
                known.widen(kind);
                members.push(place);
            }
            None => kinds.push((kind, vec![place])),
        }
    }
    kinds.sort_by_key(|(_, members)| std::cmp::Reverse(members.len()));
    kinds.into_iter().map(|(kind, members)| ReasonGroup { text: kind.text(), members }).collect()
}

/// A text split at its numbers: the words before, between and behind them, and the least and largest value of each number.
struct Kind<'a> {
    words: Vec<&'a str>,
    numbers: Vec<[Number<'a>; 2]>,
}

#[derive(Clone, Copy)]
struct Number<'a> {
    text: &'a str,
    value: f64,
}

impl<'a> Kind<'a> {
    fn of(text: &'a str) -> Self {
        let (mut words, mut numbers) = (Vec::new(), Vec::new());
        let (mut from, mut at) = (0, 0);
        while let Some(letter) = text[at..].chars().next() {
            let before = text[..at].chars().next_back();
            let named = before.is_some_and(|before| before.is_alphanumeric() || before == '.');
            let end = at + if named { 0 } else { number_len(&text[at..]) };
            match text[at..end].parse() {
                Ok(value) => {
                    words.push(&text[from..at]);
                    numbers.push([Number { text: &text[at..end], value }; 2]);
                    (from, at) = (end, end);
                }
                Err(_) => at += letter.len_utf8(),
            }
        }
        words.push(&text[from..]);
        Self { words, numbers }
    }

    /// Takes the numbers of another one with the same words in.
    fn widen(&mut self, other: Self) {
        for ([least, most], [number, _]) in self.numbers.iter_mut().zip(other.numbers) {
            if number.value < least.value {
                *least = number;
            }
            if number.value > most.value {
                *most = number;
            }
        }
    }

    fn text(&self) -> String {
        let mut text = String::new();
        for (i, word) in self.words.iter().enumerate() {
            text.push_str(word);
            match self.numbers.get(i) {
                Some([least, most]) if least.value < most.value => {
                    text.push_str(&format!("{} to {}", least.text, most.text));
                }
                Some([number, _]) => text.push_str(number.text),
                None => {}
            }
        }
        text
    }
}

/// Bytes of the number that `text` begins with: digits, and a point with digits behind it.
fn number_len(text: &str) -> usize {
    let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
    let whole = digits(text);
    let part = text[whole..].strip_prefix('.').map_or(0, digits);
    if whole > 0 && part > 0 { whole + 1 + part } else { whole }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grouped(reasons: &[&str]) -> Vec<(String, Vec<usize>)> {
        told_together(reasons.iter().copied()).into_iter().map(|group| (group.text, group.members)).collect()
    }

    #[test]
    fn reasons_that_differ_in_numbers_are_one_with_the_range_they_span() {
        let reasons = [
            "dark: its middle grey level is 12, usually 80",
            "no silhouette",
            "dark: its middle grey level is 3.5, usually 80",
            "dark: its middle grey level is 7, usually 80",
        ];
        assert_eq!(
            grouped(&reasons),
            [
                ("dark: its middle grey level is 3.5 to 12, usually 80".into(), vec![0, 2, 3]),
                ("no silhouette".into(), vec![1]),
            ]
        );
    }

    #[test]
    fn numbers_in_names_tell_reasons_apart_and_other_words_too() {
        let reasons = ["P2 is known to 1.2 px", "P3 is known to 1.2 px", "P2 is known to 1.5 px"];
        assert_eq!(
            grouped(&reasons),
            [("P2 is known to 1.2 to 1.5 px".into(), vec![0, 2]), ("P3 is known to 1.2 px".into(), vec![1])]
        );
        assert_eq!(grouped(&["a 1 b", "a 1 c"]).len(), 2);
    }

    #[test]
    fn odd_texts_come_back_as_they_are() {
        for text in [
            "",
            "7",
            "ends with 3.",
            "1.2.3",
            "µ 5 °",
            "4x5",
            "99999999999999999999999999 px",
            "5 6 7",
            "-3 µm²",
        ] {
            assert_eq!(grouped(&[text, text]), [(text.to_owned(), vec![0, 1])], "{text}");
        }
        assert_eq!(grouped(&[]), []);
    }
}
