use super::*;

/// As DeepLabCut writes an analysed video.
const ANALYSED: &str = "scorer,DLC_resnet50_chain,DLC_resnet50_chain,DLC_resnet50_chain,DLC_resnet50_chain,DLC_resnet50_chain,DLC_resnet50_chain
bodyparts,hip,hip,hip,toe,toe,toe
coords,x,y,likelihood,x,y,likelihood
0,24.581830978393555,197.81887817382812,1.0,27.444324493408203,187.75238037109375,0.21
1,25.0,198.0,0.99,,,
";
/// As it writes labels of several animals since its version 2.2, with a part that belongs to none of them.
const LABELLED: &str = "scorer,,,me,me,me,me,me,me
individuals,,,left,left,right,right,single,single
bodyparts,,,toe,toe,toe,toe,floor,floor
coords,,,x,y,x,y,x,y
labeled-data,film,img0010.png,1,2,3,4,5,6
labeled-data,film,img0034.png,,,30,40,5,6
";

#[test]
fn analysed_videos_are_read_with_likelihoods_and_gaps() {
    let marks = read(ANALYSED, None).unwrap();
    assert_eq!(marks.parts, ["hip", "toe"]);
    assert_eq!(marks.images[0].marks[1].likelihood, Some(0.21));
    assert_eq!(marks.images[0].marks[0].px, Some([24.581830978393555, 197.81887817382812]));
    assert_eq!(marks.images[1].marks[1], Mark { px: None, likelihood: None });
    assert_eq!((marks.images[1].frame, marks.images[1].line), (Some(1), 5));
}

#[test]
fn labels_are_read_by_animal_with_their_images_numbers() {
    let marks = read(LABELLED, Some("right")).unwrap();
    assert_eq!((marks.parts.len(), marks.images[1].marks[0].px), (1, Some([30.0, 40.0])));
    assert_eq!(marks.images[1].name, "labeled-data/film/img0034.png");
    assert_eq!(marks.images[1].frame, Some(34));
    let short_scorer = LABELLED.replacen("scorer,,,me,me,me", "scorer,,,me", 1);
    assert_eq!(read(&short_scorer, Some("right")).unwrap(), marks);
    assert_eq!(read(LABELLED, Some("single")).unwrap().parts, ["floor"]);
    let one_column = "scorer,me,me\nbodyparts,toe,toe\ncoords,x,y\nlabeled-data\\film\\7.png,1,2\nlabeled-data/film/last.png,1,2\n";
    let marks = read(one_column, None).unwrap();
    assert_eq!((marks.images[0].frame, marks.images[1].frame), (Some(7), None));
}

#[test]
fn odd_files_are_refused_with_line_and_remedy() {
    let changed = |from: &str, to: &str| ANALYSED.replace(from, to);
    let head: String = ANALYSED.lines().take(3).map(|line| format!("{line}\n")).collect();
    for (text, individual, wanted) in [
        (
            LABELLED,
            None,
            "several individuals: say which with --individual; the file has `left`, `right`, `single`",
        ),
        (LABELLED, Some("up"), "no individual `up`; the file has `left`"),
        (ANALYSED, Some("left"), "leave out --individual"),
        (&ANALYSED[..ANALYSED.len() - 4], None, "line 5: 4 cells under a header of 7; is the file cut off?"),
        (&head, None, "line 4: there are no images below the header"),
        ("scorer,a,a\n", None, "line 2: the file ends before its row `bodyparts`"),
        (
            &changed("bodyparts", "joints"),
            None,
            "line 2: begins with `joints`; a DeepLabCut CSV has `bodyparts` here",
        ),
        (
            &changed("coords,x,y,likelihood,x,y,likelihood", "coords,x,y,likelihood,x,y"),
            None,
            "line 3: 6 cells",
        ),
        (&changed("likelihood", "z"), None, "line 3: `z` of hip is none of x, y and likelihood"),
        (&changed("coords,x,y", "coords,x,x"), None, "line 3: hip has two columns x"),
        (&changed("bodyparts,hip,hip,hip", "bodyparts,hip,rib,hip"), None, "hip lacks x or y"),
        (&changed("\n1,", "\n-1,"), None, "line 5: frame number -1 is below 0"),
        (&changed("25.0", "1e30"), None, "line 5: hip x: 1e30 px is in no picture"),
        (&changed("25.0", "left"), None, "line 5: hip x: `left` is not a finite number"),
        (&changed("0.99", "inf"), None, "line 5: hip likelihood: `inf` is not a finite number"),
    ] {
        let error = read(text, individual).unwrap_err().to_string();
        assert!(error.contains(wanted), "{wanted:?} is not in {error:?}");
    }
    let nan = read(&changed("25.0", "NaN"), None).unwrap();
    assert_eq!(nan.images[1].marks[0].px, None);
}

#[test]
fn what_is_written_is_read_back_with_its_gaps() {
    let plane = Plane::square(2.5e-4, [320.0, 60.0]);
    let gap = [f64::NAN; 3];
    let trajectory = Trajectory {
        time_s: vec![0.0, 0.01],
        keypoints: vec!["P0".into(), "P1".into()],
        position_m: vec![[0.0, f64::NAN, 0.0], [0.025, f64::NAN, -0.01], gap, [0.01, f64::NAN, -0.02]],
        std_m: None,
        pose_std_m: None,
    };
    let text = text(&trajectory, &plane).unwrap();
    assert!(
        text.starts_with(
            "scorer,rig,rig,rig,rig,rig,rig\nbodyparts,P0,P0,P0,P1,P1,P1\ncoords,x,y,likelihood,"
        ),
        "{text}"
    );
    assert!(text.contains("\n1,,,0,"), "{text}");
    let marks = read(&text, None).unwrap();
    assert_eq!(marks.images[0].marks[0], Mark { px: Some([320.0, 60.0]), likelihood: Some(1.0) });
    assert_eq!(marks.images[1].marks[0], Mark { px: None, likelihood: Some(0.0) });
    let deep = Trajectory { position_m: vec![[0.0; 3]; 4], ..trajectory };
    assert!(super::text(&deep, &plane).unwrap_err().to_string().contains("P0_y_m is observed"));
}
