//! What a tracker saw in the picture, and from there into the plane of motion.

use std::collections::HashMap;

use super::error::listed;
use super::{Imported, InterchangeError};
use camera::calibration::{Plane, Px};
use vision::Keypoint;
use vision::keypoints::Sigma;

/// A body part in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mark {
    /// Its position \[px\]; none where it was not marked.
    pub px: Option<Px>,
    /// How sure the tracker is, usually from 0 to 1; none where it does not say, as for marks made by hand.
    pub likelihood: Option<f64>,
}

/// An image as a tracker saw it.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkedImage {
    /// What the file calls it: its number or its path.
    pub name: String,
    /// Its number from 0 in the film, where the name has one.
    pub frame: Option<u64>,
    /// Its line in the file.
    pub line: u64,
    /// One for each body part.
    pub marks: Vec<Mark>,
}

/// What a tracker saw of one mechanism.
#[derive(Debug, Clone, PartialEq)]
pub struct Marks {
    /// The body parts' names.
    pub parts: Vec<String>,
    /// The images, in the file's order.
    pub images: Vec<MarkedImage>,
}

/// What says when images were taken.
#[derive(Debug, Clone, PartialEq)]
pub enum Times {
    /// Images a second, the image of number 0 at 0 s.
    Rate(f64),
    /// A table of names and times \[s\].
    Table(Vec<(String, f64)>),
}

/// A keypoint's name, and which body part it is.
pub type Choice = (String, usize);

/// Which of `parts` are keypoints. `asked`: parts separated by commas, `a,b,c` for P0, P1, P2, or with names `P1=a,P2=b`. Left out:
/// those that are called P0, P1, ... themselves.
///
/// # Errors
/// [`InterchangeError::Choice`] with the parts that there are.
pub fn chosen(parts: &[String], asked: Option<&str>) -> Result<Vec<Choice>, InterchangeError> {
    let Some(asked) = asked else {
        let number = |part: &str| part.strip_prefix(['P', 'p']).and_then(|rest| rest.parse::<u32>().ok());
        let mut named: Vec<(u32, usize)> =
            parts.iter().enumerate().filter_map(|(at, part)| number(part).map(|n| (n, at))).collect();
        named.sort_unstable();
        if named.is_empty() {
            let what = format!(
                "no body part is called P0, P1, ...; say which they are with --keypoints a,b,c (or P1=a,P2=b): the file has {}",
                listed(parts)
            );
            return Err(InterchangeError::choice(what));
        }
        return distinct(named.into_iter().map(|(n, at)| (format!("P{n}"), at)).collect());
    };
    let one = |(i, item): (usize, &str)| {
        let (name, part) =
            item.split_once('=').map_or((format!("P{i}"), item), |(name, part)| (name.trim().into(), part));
        let part = part.trim();
        match parts.iter().position(|known| known == part) {
            Some(at) => Ok((name, at)),
            None => {
                let what = format!("there is no body part `{part}`; the file has {}", listed(parts));
                Err(InterchangeError::choice(what))
            }
        }
    };
    distinct(asked.split(',').enumerate().map(one).collect::<Result<_, _>>()?)
}

/// Refuses choices in which a keypoint or a body part comes twice.
fn distinct(choices: Vec<Choice>) -> Result<Vec<Choice>, InterchangeError> {
    for (i, (name, part)) in choices.iter().enumerate() {
        if choices[..i].iter().any(|(earlier, other)| earlier == name || other == part) {
            return Err(InterchangeError::choice(format!(
                "--keypoints: `{name}`, or what it is, comes twice"
            )));
        }
    }
    Ok(choices)
}

impl Marks {
    /// When each image was taken \[s\], strictly rising.
    ///
    /// # Errors
    /// [`InterchangeError`] when images are out of order, or `times` do not know one.
    pub fn times_s(&self, times: &Times) -> Result<Vec<f64>, InterchangeError> {
        let table = match times {
            Times::Rate(_) => None,
            Times::Table(rows) => Some(Table::of(rows)),
        };
        let time = |image: &MarkedImage| match (times, &table, image.frame) {
            (_, Some(table), _) => table.time_s(image),
            (Times::Rate(fps), None, Some(frame)) => Ok(frame as f64 / fps),
            _ => Err(InterchangeError::line(
                image.line,
                format!(
                    "`{}` does not end in an image's number; give a table of times (--times)",
                    image.name
                ),
            )),
        };
        let mut times_s: Vec<f64> = Vec::with_capacity(self.images.len());
        for (i, image) in self.images.iter().enumerate() {
            let time_s = time(image)?;
            if times_s.last().is_some_and(|last| *last >= time_s) {
                let what = format!(
                    "image {} does not come after {} of the row above; sort the rows by image and drop doubles",
                    image.name,
                    self.images[i - 1].name
                );
                return Err(InterchangeError::line(image.line, what));
            }
            times_s.push(time_s);
        }
        Ok(times_s)
    }

    /// The `keypoints` in the plane of motion at `times_s`, one for each image. A mark less sure than `least_likelihood` counts as
    /// not seen. `std_px` is the marks' sigma per axis where it is known; else the trajectory has none.
    pub fn imported(
        &self,
        keypoints: &[Choice],
        times_s: &[f64],
        plane: &Plane,
        least_likelihood: f64,
        std_px: Option<f64>,
    ) -> Imported {
        let mut imported = Imported::of(keypoints.iter().map(|(name, _)| name.clone()).collect());
        let mut std_m = Vec::new();
        for (image, time_s) in self.images.iter().zip(times_s) {
            let mut points = Vec::with_capacity(keypoints.len());
            for (name, part) in keypoints {
                let measured = place(image.marks[*part], plane, least_likelihood, std_px.unwrap_or(f64::NAN));
                let alias = (name != &self.parts[*part]).then(|| format!("{}, ", self.parts[*part]));
                std_m.push(measured.as_ref().map_or(f64::NAN, |keypoint| keypoint.std_m));
                points.push(match measured {
                    Ok(keypoint) => Ok(keypoint.metres),
                    Err(why) => Err(alias.unwrap_or_default() + &why),
                });
            }
            imported.push(image.name.clone(), *time_s, points);
        }
        imported.trajectory.std_m = std_px.map(|_| std_m);
        imported
    }
}

fn place(mark: Mark, plane: &Plane, least_likelihood: f64, std_px: f64) -> Result<Keypoint, String> {
    let px = mark.px.ok_or("not seen")?;
    if let Some(likelihood) = mark.likelihood.filter(|likelihood| *likelihood < least_likelihood) {
        return Err(format!("likelihood {likelihood:.3} is below {least_likelihood}"));
    }
    let keypoint = Keypoint::seen(px, Sigma::untold(std_px), plane);
    match keypoint.metres.iter().all(|metres| metres.is_finite()) {
        true => Ok(keypoint),
        false => Err(format!("the calibration shows no place at [{}, {}] px", px[0], px[1])),
    }
}

/// A table of times, to look images up in.
struct Table<'a> {
    rows: &'a [(String, f64)],
    by_name: HashMap<&'a str, usize>,
    /// Where all its names are numbers.
    by_number: Option<HashMap<u64, usize>>,
}

impl<'a> Table<'a> {
    fn of(rows: &'a [(String, f64)]) -> Self {
        let names = || rows.iter().map(|(name, _)| name.as_str()).enumerate();
        let number = |(row, name): (usize, &str)| name.parse().ok().map(|number| (number, row));
        let by_name = names().map(|(row, name)| (name, row)).collect();
        Self { rows, by_name, by_number: names().map(number).collect() }
    }

    /// The time of `image`: by its name; by its number where the table's names are numbers; else by its row.
    fn time_s(&self, image: &MarkedImage) -> Result<f64, InterchangeError> {
        let base = image.name.rsplit(['/', '\\']).next().unwrap_or_default();
        let row = self.by_name.get(base).copied().or_else(|| {
            let frame = image.frame?;
            match &self.by_number {
                Some(by_number) => by_number.get(&frame).copied(),
                // A picture's own number need not begin at 0.
                None => base.parse::<f64>().ok().and_then(|_| usize::try_from(frame).ok()),
            }
        });
        row.and_then(|row| self.rows.get(row)).map(|(_, time_s)| *time_s).ok_or_else(|| {
            let what = format!(
                "image {} is not in the table of times, which has {} rows",
                image.name,
                self.rows.len()
            );
            InterchangeError::line(image.line, what)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vision::Status;

    fn marks(names: &[&str]) -> Marks {
        let image = |(i, name): (usize, &&str)| MarkedImage {
            name: (*name).into(),
            frame: name.parse().ok(),
            line: i as u64 + 4,
            marks: vec![
                Mark { px: Some([110.0, 30.0]), likelihood: Some(0.9) },
                Mark { px: None, likelihood: None },
            ],
        };
        Marks {
            parts: vec!["hip".into(), "toe".into()],
            images: names.iter().enumerate().map(image).collect(),
        }
    }

    fn names(of: &[&str]) -> Vec<String> {
        of.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn parts_called_like_keypoints_are_keypoints_by_number() {
        let found = chosen(&names(&["P10", "nose", "p2", "P"]), None).unwrap();
        assert_eq!(found, [("P2".to_owned(), 2), ("P10".to_owned(), 0)]);
    }

    #[test]
    fn parts_are_chosen_in_order_or_by_name_and_unknown_ones_refused_with_those_there_are() {
        let parts = names(&["hip", "knee", "toe"]);
        assert_eq!(chosen(&parts, Some("toe, hip")).unwrap(), [("P0".to_owned(), 2), ("P1".to_owned(), 0)]);
        assert_eq!(chosen(&parts, Some("P1=knee,P2=toe")).unwrap()[1], ("P2".to_owned(), 2));
        for (asked, wanted) in [
            (None, "--keypoints a,b,c"),
            (Some("hip,elbow"), "no body part `elbow`; the file has `hip`, `knee`, `toe`"),
            (Some("hip,hip"), "twice"),
            (Some("P1=hip,P1=toe"), "twice"),
        ] {
            let error = chosen(&parts, asked).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        }
    }

    #[test]
    fn times_come_from_the_rate_or_a_table_by_name_number_or_row() {
        let times = |images: &[&str], times: Times| marks(images).times_s(&times);
        assert_eq!(times(&["0", "3"], Times::Rate(50.0)).unwrap(), [0.0, 0.06]);
        let table = |of: &[&str]| {
            Times::Table(of.iter().enumerate().map(|(i, name)| ((*name).into(), 0.5 + i as f64)).collect())
        };
        assert_eq!(times(&["labeled-data/a/b.png"], table(&["a.png", "b.png"])).unwrap(), [1.5]);
        assert_eq!(times(&["7", "8"], table(&["000006", "000007", "000008"])).unwrap(), [1.5, 2.5]);
        assert_eq!(times(&["0", "2"], table(&["x1.png", "x2.png", "x3.png"])).unwrap(), [0.5, 2.5]);
        for (images, given, wanted) in [
            (&["3", "2"][..], Times::Rate(1.0), "line 5: image 2 does not come after 3"),
            (&["3", "3"], Times::Rate(1.0), "does not come after"),
            (&["a.png"], Times::Rate(1.0), "--times"),
            (&["9"], table(&["000006"]), "not in the table"),
            (&["9"], table(&["x.png"]), "not in the table"),
        ] {
            let error = times(images, given).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        }
    }

    #[test]
    fn unsure_and_unseen_marks_are_gaps_with_their_reasons() {
        let plane = Plane::square(0.001, [100.0, 50.0]);
        let choices = chosen(&names(&["hip", "toe"]), Some("hip,toe")).unwrap();
        let seen = marks(&["0"]).imported(&choices, &[0.0], &plane, 0.6, Some(2.0));
        let [x, y, z] = seen.trajectory.at(0, 0);
        assert!((x - 0.01).abs() < 1e-12 && y.is_nan() && (z - 0.02).abs() < 1e-12);
        let std_m = seen.trajectory.std_m.unwrap();
        assert!((std_m[0] - 0.002).abs() < 1e-12 && std_m[1].is_nan());
        assert_eq!(
            (seen.images[0].status, seen.images[0].reason.as_str()),
            (Status::Doubtful, "P1: toe, not seen")
        );
        let unsure = marks(&["0"]).imported(&choices, &[0.0], &plane, 0.95, None);
        assert_eq!(unsure.trajectory.std_m, None);
        assert_eq!(unsure.images[0].status, Status::Rejected);
        assert!(unsure.images[0].reason.starts_with("P0: hip, likelihood 0.900 is below 0.95; "));
    }
}
