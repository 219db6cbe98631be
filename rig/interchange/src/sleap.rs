//! SLEAP's analysis CSV: `track,frame_idx,instance.score,<node>.x,<node>.y,<node>.score,...`, a row for each animal in each image that
//! shows it. Marks made by hand have no score.

use super::error::listed;
use super::sheet::{self, Row};
use super::{InterchangeError, Mark, MarkedImage, Marks};

/// Where a node's numbers stand in a row: x, y, score.
type Columns = (usize, usize, Option<usize>);

/// Reads `text`; of several tracks the one that is called `track`.
///
/// # Errors
/// [`InterchangeError`] with the line.
pub fn read(text: &str, track: Option<&str>) -> Result<Marks, InterchangeError> {
    let rows = sheet::rows(text)?;
    let Some((head, below)) = rows.split_first() else {
        return Err(InterchangeError::Unknown { what: "empty".into() });
    };
    let (line, titles) = head;
    let at = |title: &str| titles.iter().position(|known| known == title);
    let Some(frame) = at("frame_idx") else {
        return Err(InterchangeError::line(*line, "no column `frame_idx`; a SLEAP analysis CSV has one"));
    };
    let mut nodes: Vec<(String, Columns)> = Vec::new();
    for (x, title) in titles.iter().enumerate() {
        let Some(node) = title.strip_suffix(".x") else { continue };
        if nodes.iter().any(|(known, _)| known == node) {
            return Err(InterchangeError::line(*line, format!("two columns `{title}`")));
        }
        let Some(y) = at(&format!("{node}.y")) else {
            return Err(InterchangeError::line(
                *line,
                format!("`{title}` without `{node}.y`; is the header cut off?"),
            ));
        };
        nodes.push((node.to_owned(), (x, y, at(&format!("{node}.score")))));
    }
    if nodes.is_empty() {
        return Err(InterchangeError::line(*line, "no columns `<node>.x` and `<node>.y`"));
    }
    for row in below {
        sheet::check_width(row, titles.len())?;
    }
    let track_of = |row: &Row| at("track").map_or("", |at| &row.1[at]).to_owned();
    let wanted = whose(below.iter().map(track_of), track)?;
    let images: Vec<MarkedImage> = below
        .iter()
        .filter(|row| track_of(row) == wanted)
        .map(|row| marked_image(row, frame, &nodes))
        .collect::<Result<_, _>>()?;
    for (above, image) in images.iter().zip(&images[1..]) {
        if above.frame == image.frame {
            let what = format!(
                "a second animal of track `{wanted}` in image {}, after line {}; keep one of them",
                image.name, above.line
            );
            return Err(InterchangeError::line(image.line, what));
        }
    }
    Ok(Marks { parts: nodes.into_iter().map(|(node, _)| node).collect(), images })
}

/// The track that is meant; the empty name is that of what has no track.
fn whose(tracks: impl Iterator<Item = String>, asked: Option<&str>) -> Result<String, InterchangeError> {
    let mut names: Vec<String> = Vec::new();
    for name in tracks {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    match (asked, &names[..]) {
        (_, []) => {
            Err(InterchangeError::choice("there are no images below the header; is the file cut off?"))
        }
        (Some(asked), _) if names.iter().any(|name| name == asked) => Ok(asked.into()),
        (Some(asked), _) => Err(InterchangeError::choice(format!(
            "there is no track `{asked}`; the file has {}",
            listed(&names)
        ))),
        (None, [only]) => Ok(only.clone()),
        (None, _) => {
            let what =
                format!("several tracks: say which with --individual; the file has {}", listed(&names));
            Err(InterchangeError::choice(what))
        }
    }
}

fn marked_image(
    (line, row): &Row,
    frame: usize,
    nodes: &[(String, Columns)],
) -> Result<MarkedImage, InterchangeError> {
    let name = row[frame].to_owned();
    let Some(frame) = sheet::frame(&name, *line)? else {
        return Err(InterchangeError::line(*line, format!("frame_idx `{name}` is not a number")));
    };
    let mark = |(node, (x, y, score)): &(String, Columns)| {
        let coordinate =
            |at: usize, axis: &str| sheet::coordinate(&row[at], *line, &format!("{node}.{axis}"));
        let px = coordinate(*x, "x")?.zip(coordinate(*y, "y")?).map(|(x, y)| [x, y]);
        let score = score.map(|at| sheet::number(&row[at], *line, &format!("{node}.score"))).transpose()?;
        Ok(Mark { px, likelihood: score.flatten() })
    };
    let marks = nodes.iter().map(mark).collect::<Result<Vec<_>, InterchangeError>>()?;
    Ok(MarkedImage { name, frame: Some(frame), line: *line, marks })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As SLEAP's GUI writes it; the second animal is unsure of its tail, the last row was made by hand.
    const FILE: &str = "track,frame_idx,instance.score,head.x,head.y,head.score,tail.x,tail.y,tail.score
track_0,0,0.93,101.5,55.25,0.97,140.0,60.0,0.88
track_1,0,0.91,201.5,55.25,0.97,240.0,60.0,0.18
track_0,3,,102.0,56.0,,,,
";

    #[test]
    fn a_track_is_read_image_by_image_with_scores_where_there_are_any() {
        let marks = read(FILE, Some("track_0")).unwrap();
        assert_eq!(marks.parts, ["head", "tail"]);
        assert_eq!(marks.images.iter().map(|image| image.frame).collect::<Vec<_>>(), [Some(0), Some(3)]);
        assert_eq!(marks.images[0].marks[1], Mark { px: Some([140.0, 60.0]), likelihood: Some(0.88) });
        assert_eq!(marks.images[1].marks[0], Mark { px: Some([102.0, 56.0]), likelihood: None });
        assert_eq!(marks.images[1].marks[1].px, None);
    }

    #[test]
    fn columns_may_stand_in_any_order_and_untracked_animals_have_no_name() {
        let text = "frame_idx,a.b.score,a.b.x,a.b.y,other\n0,0.5,1,2,x\n1,0.5,3,4,y\n";
        let marks = read(text, None).unwrap();
        assert_eq!((marks.parts[0].as_str(), marks.images[1].marks[0].px), ("a.b", Some([3.0, 4.0])));
    }

    #[test]
    fn odd_files_are_refused_with_line_and_remedy() {
        let (head, cut) = (&FILE[..FILE.find('\n').unwrap()], &FILE[..FILE.len() - 4]);
        let row = |text: &str| format!("{head}\n{text}\n");
        for (text, track, wanted) in [
            (FILE, None, "--individual; the file has `track_0`, `track_1`"),
            (FILE, Some("fly"), "no track `fly`; the file has `track_0`"),
            (cut, Some("track_0"), "line 4: 6 cells under a header of 9; is the file cut off?"),
            (head, None, "no images below the header"),
            (&row("t,-1,,1,2,,3,4,"), None, "line 2: frame number -1 is below 0"),
            (&row("t,a,,1,2,,3,4,"), None, "line 2: frame_idx `a` is not a number"),
            (&row("t,0,,1e9,2,,3,4,"), None, "line 2: head.x: 1e9 px is in no picture"),
            (&row("t,0,,left,2,,3,4,"), None, "line 2: head.x: `left` is not a finite number"),
            (
                &row("t,0,,1,2,,3,4,\nt,0,,1,2,,3,4,"),
                None,
                "line 3: a second animal of track `t` in image 0, after line 2",
            ),
            ("track,frame_idx,head.x\n,0,1\n", None, "line 1: `head.x` without `head.y`"),
            ("track,frame_idx,score\n,0,1\n", None, "no columns `<node>.x`"),
            ("track,frame\n,0\n", None, "no column `frame_idx`"),
        ] {
            let error = read(text, track).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        }
    }
}
