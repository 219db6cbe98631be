//! DeepLabCut's CSV: three header rows (`scorer`, `bodyparts`, `coords`; with several animals `individuals` after the first), then
//! an image a row. Analysed videos have an image's number in the first column and a likelihood for each body part; labels made
//! by hand have an image's path there, in one column or three, and no likelihood.

use sim::Trajectory;

use super::error::listed;
use super::sheet::{self, Row};
use super::{InterchangeError, Mark, MarkedImage, Marks};
use camera::calibration::Plane;

/// Where a body part's numbers stand in a row.
#[derive(Debug, Clone, Copy, Default)]
struct Columns {
    x: Option<usize>,
    y: Option<usize>,
    likelihood: Option<usize>,
}

/// Reads `text`; of several animals the one that is called `individual`.
///
/// # Errors
/// [`InterchangeError`] with the line.
pub fn read(text: &str, individual: Option<&str>) -> Result<Marks, InterchangeError> {
    let rows = sheet::rows(text)?;
    let titles = |at: usize, wanted: &str| match rows.get(at) {
        Some((_, row)) if row.get(0) == Some(wanted) => Ok(row),
        Some((line, row)) => {
            let found = row.get(0).unwrap_or_default();
            Err(InterchangeError::line(
                *line,
                format!("begins with `{found}`; a DeepLabCut CSV has `{wanted}` here"),
            ))
        }
        None => {
            Err(InterchangeError::line(at as u64 + 1, format!("the file ends before its row `{wanted}`")))
        }
    };
    titles(0, "scorer")?;
    let several = rows.get(1).is_some_and(|(_, row)| row.get(0) == Some("individuals"));
    let individuals = if several { Some(titles(1, "individuals")?) } else { None };
    let first = if several { 3 } else { 2 };
    let (parts, coords) = (titles(first - 1, "bodyparts")?, titles(first, "coords")?);
    // Of the scorer's row nothing is used but its beginning.
    for row in &rows[1..=first] {
        sheet::check_width(row, parts.len())?;
    }
    // What names an image takes as many columns as have no coordinate above them.
    let index = coords.iter().skip(1).take_while(|title| title.is_empty()).count() + 1;
    let wanted = individuals.map(|row| whose(row, index, individual)).transpose()?;
    if individuals.is_none() && individual.is_some() {
        return Err(InterchangeError::choice(
            "the file has one animal without a name; leave out --individual",
        ));
    }

    let mut found: Vec<(String, Columns)> = Vec::new();
    for column in index..coords.len() {
        if individuals.zip(wanted.as_deref()).is_some_and(|(row, wanted)| &row[column] != wanted) {
            continue;
        }
        let at = found.iter().position(|(part, _)| *part == parts[column]).unwrap_or_else(|| {
            found.push((parts[column].to_owned(), Columns::default()));
            found.len() - 1
        });
        let (part, columns) = &mut found[at];
        let place = match &coords[column] {
            "x" => &mut columns.x,
            "y" => &mut columns.y,
            "likelihood" => &mut columns.likelihood,
            other => {
                let what = format!(
                    "`{other}` of {part} is none of x, y and likelihood: only films of one camera can be read"
                );
                return Err(InterchangeError::line(first as u64 + 1, what));
            }
        };
        if place.replace(column).is_some() {
            let what = format!("{part} has two columns {}", &coords[column]);
            return Err(InterchangeError::line(first as u64 + 1, what));
        }
    }
    if let Some((part, _)) = found.iter().find(|(_, columns)| columns.x.is_none() || columns.y.is_none()) {
        return Err(InterchangeError::line(
            first as u64 + 1,
            format!("{part} lacks x or y; is the header cut off?"),
        ));
    }
    if found.is_empty() {
        return Err(InterchangeError::line(first as u64 + 1, "there are no body parts"));
    }
    let images = rows[first + 1..]
        .iter()
        .map(|row| marked_image(row, index, coords.len(), &found))
        .collect::<Result<Vec<_>, _>>()?;
    if images.is_empty() {
        return Err(InterchangeError::line(
            first as u64 + 2,
            "there are no images below the header; is the file cut off?",
        ));
    }
    Ok(Marks { parts: found.into_iter().map(|(part, _)| part).collect(), images })
}

/// The animal that is meant.
fn whose(row: &csv::StringRecord, index: usize, asked: Option<&str>) -> Result<String, InterchangeError> {
    let mut names: Vec<&str> = Vec::new();
    for name in row.iter().skip(index) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    match (asked, &names[..]) {
        (Some(asked), _) if names.contains(&asked) => Ok(asked.into()),
        (Some(asked), _) => Err(InterchangeError::choice(format!(
            "there is no individual `{asked}`; the file has {}",
            listed(&names)
        ))),
        (None, [only]) => Ok((*only).into()),
        (None, _) => {
            let what =
                format!("several individuals: say which with --individual; the file has {}", listed(&names));
            Err(InterchangeError::choice(what))
        }
    }
}

fn marked_image(
    row: &Row,
    index: usize,
    width: usize,
    parts: &[(String, Columns)],
) -> Result<MarkedImage, InterchangeError> {
    sheet::check_width(row, width)?;
    let (line, row) = row;
    let name = row.iter().take(index).collect::<Vec<_>>().join("/");
    let frame = match sheet::frame(&name, *line)? {
        Some(frame) => Some(frame),
        None => number_at_the_end(&name),
    };
    let cell = |column: Option<usize>, title: &str, part: &str| match column {
        Some(column) if title == "likelihood" => {
            sheet::number(&row[column], *line, &format!("{part} {title}"))
        }
        Some(column) => sheet::coordinate(&row[column], *line, &format!("{part} {title}")),
        None => Ok(None),
    };
    let mark = |(part, columns): &(String, Columns)| {
        let (x, y) = (cell(columns.x, "x", part)?, cell(columns.y, "y", part)?);
        let likelihood = cell(columns.likelihood, "likelihood", part)?;
        Ok(Mark { px: x.zip(y).map(|(x, y)| [x, y]), likelihood })
    };
    let marks = parts.iter().map(mark).collect::<Result<Vec<_>, InterchangeError>>()?;
    Ok(MarkedImage { name, frame, line: *line, marks })
}

/// The number that a picture's name ends in: `img0034.png` is image 34 of its film.
fn number_at_the_end(name: &str) -> Option<u64> {
    let base = name.rsplit(['/', '\\']).next()?;
    let stem = base.rsplit_once('.').map_or(base, |(stem, _)| stem);
    stem[stem.trim_end_matches(|letter: char| letter.is_ascii_digit()).len()..].parse().ok()
}

/// `trajectory` as DeepLabCut would have written it for one animal: images counted from 0, each keypoint where `plane` shows it,
/// likelihood 1; 0 and no place where there is a gap. Times and deviations have no place in it.
///
/// # Errors
/// [`InterchangeError::Choice`] where a keypoint moves towards the camera, which no picture shows.
pub fn text(trajectory: &Trajectory, plane: &Plane) -> Result<String, InterchangeError> {
    let width = trajectory.keypoints.len();
    let (view, depth) = (plane.view(), plane.view().depth_axis());
    if let Some(cell) = trajectory.position_m.iter().position(|place| place[depth].is_finite()) {
        let what = format!(
            "{}_{}_m is observed: a picture shows the plane of motion only, by the calibration {view}",
            trajectory.keypoints[cell % width],
            ["x", "y", "z"][depth]
        );
        return Err(InterchangeError::choice(what));
    }
    let mut csv = csv::Writer::from_writer(Vec::new());
    let head = |first: &str, of: &dyn Fn(usize) -> String| -> Vec<String> {
        std::iter::once(first.to_owned()).chain((0..3 * width).map(of)).collect()
    };
    csv.write_record(head("scorer", &|_| "rig".into()))?;
    csv.write_record(head("bodyparts", &|at| trajectory.keypoints[at / 3].clone()))?;
    csv.write_record(head("coords", &|at| ["x", "y", "likelihood"][at % 3].into()))?;
    for (image, row) in trajectory.position_m.chunks(width.max(1)).enumerate() {
        let mut cells = vec![image.to_string()];
        for place in row {
            let px = plane.pixel(view.seen(*place));
            match px.iter().all(|side| side.is_finite()) {
                true => cells.extend([px[0].to_string(), px[1].to_string(), "1".into()]),
                false => cells.extend([String::new(), String::new(), "0".into()]),
            }
        }
        csv.write_record(cells)?;
    }
    let bytes = csv.into_inner().map_err(|error| csv::Error::from(error.into_error()))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

#[cfg(test)]
mod tests;
