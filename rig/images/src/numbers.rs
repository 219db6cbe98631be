//! Which image of a film a picture's file is, by the number in its name.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use camera::source::FolderError;

/// Files in the order in which they were filmed.
#[derive(Debug, PartialEq)]
pub(super) struct Numbered {
    /// Each file with its place in the film, from 0. Where files are missing in between, their places stay empty.
    pub files: Vec<(PathBuf, u64)>,
    /// What is to be known of the order or of the places, as a sentence without its full stop.
    pub remark: Option<String>,
}

/// Most places a film may have for each of its files, chosen: beyond that, numbers are times or something else.
const MAX_PLACES_PER_FILE: u64 = 10;

/// Puts `files` in order by the one number in which their names differ, which is the image's number; where there is none, or more than one, in
/// the natural order of their names, in which `img2` is before `img10`.
///
/// # Errors
/// [`FolderError::Numbers`] where two have the same number, or where numbers cannot be those of images.
pub(super) fn in_order(folder: &Path, files: Vec<PathBuf>) -> Result<Numbered, FolderError> {
    let mut named: Vec<(Vec<Part>, PathBuf)> = files.into_iter().map(|path| (parts(&path), path)).collect();
    named.sort_by(|(a, path_a), (b, path_b)| compare(a, b).then_with(|| path_a.cmp(path_b)));
    match changing(&named) {
        Changing::Number(at) => numbered(folder, named, at),
        Changing::Words => Ok(one_after_the_other(named, None)),
        Changing::Several => {
            let first = &named[0].1;
            let last = &named[named.len() - 1].1;
            let remark = format!(
                "the names of the pictures in {} differ in more than one number or in words beside a number (from {} to {}): they are \
                 taken in the order of their names and evenly spaced; if that is wrong, a frames.csv says which is when",
                folder.display(),
                name(first),
                name(last),
            );
            Ok(one_after_the_other(named, Some(remark)))
        }
    }
}

/// A part of a name: its digits as a number, or what is between them.
#[derive(Debug, PartialEq)]
enum Part {
    Word(String),
    Number(u64),
}

fn parts(path: &Path) -> Vec<Part> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let mut parts = Vec::new();
    let mut rest = &*stem;
    while let Some(first) = rest.chars().next() {
        let is_number = first.is_ascii_digit();
        let end = rest.find(|c: char| c.is_ascii_digit() != is_number).unwrap_or(rest.len());
        let (part, behind) = rest.split_at(end);
        // A row of digits that no u64 holds is no image's number.
        parts.push(part.parse().map_or_else(|_| Part::Word(part.to_owned()), Part::Number));
        rest = behind;
    }
    parts
}

fn compare(a: &[Part], b: &[Part]) -> Ordering {
    let part = |(a, b): (&Part, &Part)| match (a, b) {
        (Part::Number(a), Part::Number(b)) => a.cmp(b),
        (Part::Word(a), Part::Word(b)) => a.cmp(b),
        (Part::Number(_), Part::Word(_)) => Ordering::Less,
        (Part::Word(_), Part::Number(_)) => Ordering::Greater,
    };
    let differ = a.iter().zip(b).map(part).find(|order| order.is_ne());
    differ.unwrap_or_else(|| a.len().cmp(&b.len()))
}

/// What tells the names apart.
enum Changing {
    /// The number at this place among a name's parts.
    Number(usize),
    /// No number: there is none, or none differs.
    Words,
    Several,
}

fn changing(named: &[(Vec<Part>, PathBuf)]) -> Changing {
    let [(first, _), others @ ..] = named else { return Changing::Words };
    let differ = |at: usize| others.iter().any(|(parts, _)| parts.get(at) != first.get(at));
    let longest = named.iter().map(|(parts, _)| parts.len()).max().unwrap_or(0);
    let is_number = |at: usize| named.iter().all(|(parts, _)| matches!(parts.get(at), Some(Part::Number(_))));
    let places: Vec<usize> = (0..longest).filter(|&at| differ(at)).collect();
    let has_numbers = named.iter().any(|(parts, _)| parts.iter().any(|part| matches!(part, Part::Number(_))));
    match places[..] {
        [at] if is_number(at) => Changing::Number(at),
        [] if has_numbers => {
            Changing::Number(first.iter().rposition(|part| matches!(part, Part::Number(_))).unwrap_or(0))
        }
        _ if has_numbers => Changing::Several,
        _ => Changing::Words,
    }
}

fn one_after_the_other(named: Vec<(Vec<Part>, PathBuf)>, remark: Option<String>) -> Numbered {
    Numbered { files: named.into_iter().map(|(_, path)| path).zip(0..).collect(), remark }
}

fn numbered(folder: &Path, named: Vec<(Vec<Part>, PathBuf)>, at: usize) -> Result<Numbered, FolderError> {
    let refuse = |what: String| Err(FolderError::Numbers { path: folder.into(), what });
    let number = |(parts, path): (Vec<Part>, PathBuf)| match parts.get(at) {
        Some(Part::Number(number)) => (path, *number),
        _ => (path, 0),
    };
    let mut files: Vec<(PathBuf, u64)> = named.into_iter().map(number).collect();
    if let Some([(one, number), (other, _)]) = files.windows(2).find(|pair| pair[0].1 == pair[1].1) {
        return refuse(format!("{} and {} are both number {number}", name(one), name(other)));
    }
    let first = files.first().map_or(0, |(_, number)| *number);
    files.iter_mut().for_each(|(_, number)| *number -= first);
    let places = files.last().map_or(0, |(_, place)| *place) + 1;
    let steps = || files.windows(2).map(|pair| pair[1].1 - pair[0].1);
    let stride = steps().fold(0, greatest_common_divisor).max(1);
    if (places - 1) / stride + 1 > MAX_PLACES_PER_FILE * files.len() as u64 {
        return refuse(format!(
            "they run over {places} in {} files, which are not the numbers of images",
            files.len()
        ));
    }
    let missing = (places - 1) / stride + 1 - files.len() as u64;
    let mut remarks = Vec::new();
    if stride > 1 {
        remarks.push(format!(
            "count in steps of {stride}: each picture is taken to be every {stride}th image of the film"
        ));
    }
    if let Some([(_, before), (_, after)]) = files.windows(2).find(|pair| pair[1].1 - pair[0].1 > stride) {
        let from = first + before + stride;
        remarks.push(format!(
            "have gaps: {missing} of {} are not there, the first of them {from}; each keeps its time, at which there is no image (a gap of \
             {:.0} images at once there)",
            missing + files.len() as u64,
            ((after - before) / stride - 1) as f64,
        ));
    }
    let remark = (!remarks.is_empty()).then(|| {
        format!("the numbers in the names of the pictures in {} {}", folder.display(), remarks.join(", and "))
    });
    Ok(Numbered { files, remark })
}

fn greatest_common_divisor(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

fn name(path: &Path) -> std::path::Display<'_> {
    Path::new(path.file_name().unwrap_or_default()).display()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names with their places, and the remark.
    type Ordered = (Vec<(String, u64)>, Option<String>);

    fn ordered(names: &[&str]) -> Result<Ordered, String> {
        let files = names.iter().map(PathBuf::from).collect();
        let Numbered { files, remark } =
            in_order(Path::new("film"), files).map_err(|error| error.to_string())?;
        Ok((files.into_iter().map(|(path, place)| (path.display().to_string(), place)).collect(), remark))
    }

    fn places(names: &[&str]) -> Vec<u64> {
        ordered(names).unwrap().0.into_iter().map(|(_, place)| place).collect()
    }

    #[test]
    fn numbers_without_leading_zeros_are_numbers() {
        let (files, remark) = ordered(&["img1.png", "img10.png", "img2.png", "img11.png"]).unwrap();
        let expected = [("img1.png", 0), ("img2.png", 1), ("img10.png", 9), ("img11.png", 10)];
        assert_eq!(files, expected.map(|(name, place)| (name.to_owned(), place)));
        assert!(remark.unwrap().contains("7 of 11 are not there, the first of them 3"));
        assert_eq!(places(&["run2_img098.png", "run2_img099.png", "run2_img100.jpg"]), [0, 1, 2]);
        assert_eq!(ordered(&["0007.png"]).unwrap(), (vec![("0007.png".to_owned(), 0)], None));
    }

    #[test]
    fn a_step_that_all_numbers_have_is_told_and_kept() {
        let (files, remark) = ordered(&["a0.png", "a10.png", "a20.png", "a40.png"]).unwrap();
        assert_eq!(files.last().unwrap().1, 40);
        let remark = remark.unwrap();
        assert!(
            remark.contains("every 10th image")
                && remark.contains("1 of 5 are not there, the first of them 30"),
            "{remark}"
        );
    }

    #[test]
    fn what_has_no_number_of_its_own_is_evenly_spaced() {
        assert_eq!(ordered(&["c.png", "a.png", "b.png"]).unwrap().1, None);
        assert_eq!(places(&["c.png", "a.png", "b.png"]), [0, 1, 2]);
        let (files, remark) = ordered(&["10-15-02.png", "10-14-58.png", "10-15-01.png"]).unwrap();
        assert_eq!(files[0].0, "10-14-58.png");
        assert_eq!(files[2].1, 2);
        assert!(remark.unwrap().contains("frames.csv"));
        assert!(ordered(&["left1.png", "right1.png", "left2.png"]).unwrap().1.is_some());
    }

    #[test]
    fn numbers_that_cannot_be_those_of_images_are_refused() {
        let twice = ordered(&["img1.png", "img01.png", "img2.png"]).unwrap_err();
        assert!(twice.contains("img01.png and img1.png are both number 1"), "{twice}");
        assert!(ordered(&["img1.png", "img1.jpg"]).unwrap_err().contains("both number 1"));
        let times = ordered(&["1700000000000.png", "1700000000020.png", "1700000000041.png"]).unwrap_err();
        assert!(times.contains("42 in 3 files") && times.contains("frames.csv"), "{times}");
        let digits = "9".repeat(40);
        assert!(
            ordered(&[&format!("{digits}.png"), "1.png"])
                .unwrap()
                .1
                .is_none_or(|remark| remark.contains("frames.csv"))
        );
    }
}
