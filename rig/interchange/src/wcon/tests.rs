use super::*;
use vision::Status;

fn with(data: &str) -> String {
    format!(
        r#"{{"units":{{"t":"s","x":"mm","y":"mm","ox":"m","oy":"m","cx":"mm","cy":"mm"}},"data":{data}}}"#
    )
}

fn points(data: &str) -> Vec<Vec<Option<[f64; 2]>>> {
    read(&with(data)).unwrap().animals.remove(0).lines.into_iter().map(|line| line.points).collect()
}

fn near(point: Option<[f64; 2]>, [x, z]: [f64; 2]) -> bool {
    point.is_some_and(|p| (p[0] - x).hypot(p[1] - z) < 1e-12)
}

#[test]
fn one_instant_or_many_bare_or_in_lists_are_the_same() {
    for data in [
        r#"{"id":1,"t":0,"x":2,"y":1.7}"#,
        r#"[{"id":1,"t":[0],"x":[2],"y":[1.7]}]"#,
        r#"[{"id":1,"t":[0],"x":[[2]],"y":[[1.7]]}]"#,
        r#"[{"id":1,"t":0,"x":[2],"y":[1.7]}]"#,
        r#"[{"id":1,"t":0,"x":-8,"y":11.7,"ox":0.01,"oy":-0.01}]"#,
        r#"[{"id":1,"t":[0],"x":[[1]],"y":[[0.7]],"cx":[1],"cy":[1]}]"#,
        r#"[{"id":1,"t":0,"x":2,"y":1.7},{"id":1,"t":[0],"x":[2],"y":[1.7]}]"#,
        r#"[{"id":1,"t":[0],"x":[[2]],"y":[[1.7]],"ox":0,"oy":0,"cx":[1],"cy":[1]}]"#,
    ] {
        let found = points(data);
        assert!(found.len() == 1 && near(found[0][0], [2e-3, 1.7e-3]), "{data}: {found:?}");
    }
}

#[test]
fn ragged_lines_missing_points_and_the_head_at_the_right_are_read() {
    let found = points(
        r#"[{"id":1,"t":[1,0],"x":[[1,2,3],[null,5]],"y":[[1,1,1],[1,1]],"head":["R","?"]},{"id":1,"t":2,"x":null,"y":null}]"#,
    );
    assert_eq!(found.iter().map(Vec::len).collect::<Vec<_>>(), [2, 3, 1]);
    assert!(found[0][0].is_none() && found[2][0].is_none() && near(found[1][0], [3e-3, 1e-3]), "{found:?}");
}

#[test]
fn keypoints_lie_at_shares_of_whole_lines() {
    let text =
        with(r#"[{"id":"a","t":[0,1,2],"x":[[0,10,10],[0,null,10],[1]],"y":[[0,0,30],[0,0,30],[1]]}]"#);
    let imported = read(&text).unwrap().imported(None, &[0.0, 0.5, 1.0]).unwrap();
    let [x, _, z] = imported.trajectory.at(0, 1);
    assert!(near(Some([x, z]), [0.01, 0.01]), "{x} {z}");
    let status: Vec<Status> = imported.images.iter().map(|image| image.status).collect();
    assert_eq!(status, [Status::Ok, Status::Rejected, Status::Rejected]);
    assert!(
        imported.images[1].reason.contains("1 of the line's 3 points are missing"),
        "{:?}",
        imported.images
    );
    assert!(imported.images[2].reason.contains("two points or more"), "{:?}", imported.images);
}

#[test]
fn tracks_may_be_a_keypoint_each() {
    let text = with(
        r#"[{"id":7,"t":[0,1],"x":[1,2],"y":[0,0]},{"id":"tip","t":[1,2],"x":[[5],[null]],"y":[[1],[1]]}]"#,
    );
    let document = read(&text).unwrap();
    let imported = document.one_each("P1=7,P2=tip").unwrap();
    assert_eq!(imported.trajectory.keypoints, ["P1", "P2"]);
    assert_eq!(imported.trajectory.time_s, [0.0, 1.0, 2.0]);
    assert_eq!(imported.trajectory.at(1, 1)[0], 5e-3);
    assert_eq!(imported.images[2].reason, "P1: not in the file at this time; P2: not seen");
    assert!(document.one_each("7,toe").unwrap_err().to_string().contains("the file has `7`, `tip`"));
}

#[test]
fn odd_documents_are_refused_with_their_place() {
    for (text, wanted) in [
        (r#"{"units":{"t":"s"#.to_owned(), "not a JSON document"),
        (r#"{"data":[]}"#.into(), "units: says no unit of t"),
        (with("[]").replace(r#""x":"mm""#, r#""x":"px""#), "units.x: `px` is no unit of length"),
        (with("7"), "data: is no list"),
        (with(r#"[{"t":0,"x":1,"y":1}]"#), "data[0]: has no id"),
        (with(r#"[{"id":1,"x":1,"y":1}]"#), "data[0].t: is missing"),
        (with(r#"[{"id":1,"t":["a"],"x":1,"y":1}]"#), r#"data[0].t[0]: "a" is not a number"#),
        (with(r#"[{"id":1,"t":0,"x":1}]"#), "data[0].y: is missing"),
        (with(r#"[{"id":1,"t":[0,1],"x":[[1]],"y":[[1]]}]"#), "data[0].x: has 1 rows for 2 times"),
        (with(r#"[{"id":1,"t":[0,1],"x":1,"y":1}]"#), "data[0].x: is one number for 2 times"),
        (with(r#"[{"id":1,"t":0,"x":[1,2],"y":[1]}]"#), "data[0].x[0]: has 2 points, y has 1"),
        (with(r#"[{"id":1,"t":0,"x":["a"],"y":[1]}]"#), r#"data[0].x[0]: "a" is not a number"#),
        (with(r#"[{"id":1,"t":0,"x":[1e300],"y":[1]}]"#), "check the units"),
        (with(r#"[{"id":1,"t":[0,1],"x":[1,2],"y":[1,2],"ox":[1],"oy":0}]"#), "data[0].ox[1]: is missing"),
        (with(r#"[{"id":1,"t":[0,0,0],"x":[1,1,2],"y":[1,1,2]}]"#), "id 1: two lines at 0 s"),
    ] {
        let error = read(&text).unwrap_err().to_string();
        assert!(error.contains(wanted), "{wanted:?} is not in {error:?}");
    }
    let two = read(&with(r#"[{"id":1,"t":0,"x":1,"y":1},{"id":2,"t":0,"x":1,"y":1}]"#)).unwrap();
    assert!(two.animal(None).unwrap_err().to_string().contains("several ids"));
    assert!(two.animal(Some("3")).unwrap_err().to_string().contains("the file has `1`, `2`"));
    assert!(read(&with("[]")).unwrap().animal(None).unwrap_err().to_string().contains("is empty"));
}

#[test]
fn what_is_written_is_read_back() {
    let names = ["P0".to_owned(), "P1".to_owned()];
    let line = Line { time_s: 0.25, points: vec![Some([0.01, -0.02]), None] };
    let written = Written { id: "run", lines: vec![line.clone()], keypoints: Some(&names), images: None };
    let document = read(&super::document(&written).to_string()).unwrap();
    assert_eq!((document.animals[0].id.as_str(), document.keypoints.as_deref()), ("run", Some(&names[..])));
    assert!(near(document.animals[0].lines[0].points[0], [0.01, -0.02]));
    let imported = document.imported(None, &[]).unwrap();
    assert_eq!(
        (imported.images[0].status, imported.images[0].reason.as_str()),
        (Status::Doubtful, "P1: not seen")
    );
}

/// What Worm tracker Commons itself gives as examples.
#[test]
fn public_files_are_read() {
    let Some(folder) = std::env::var_os("RIG_SHARED").map(std::path::PathBuf::from) else {
        eprintln!("skipped: public WCON files (RIG_SHARED is not set)");
        return;
    };
    let document =
        |name: &str| read(&std::fs::read_to_string(folder.join("data/formats").join(name)).unwrap()).unwrap();
    for name in ["spine.wcon", "perimeter.wcon"] {
        let imported = document(name).imported(None, &[0.0, 0.5, 1.0]).unwrap();
        let place = |keypoint: usize| {
            let [x, _, z] = imported.trajectory.at(0, keypoint);
            Some([x, z])
        };
        assert!(near(place(0), [1.6e-3, 1.1e-3]) && near(place(2), [2.4e-3, 2.3e-3]), "{name}: {imported:?}");
        // The comment in the file: the central point, of five at even steps, is (2.0, 1.7).
        assert!(near(place(1), [2.0e-3, 1.7e-3]), "{name}: {imported:?}");
    }
    let imported = document("two-ids.wcon").one_each("123,124").unwrap();
    let [x, _, z] = imported.trajectory.at(0, 1);
    assert!(near(Some([x, z]), [1.9e-3, 9.9e-3]), "{imported:?}");
}
