//! Pictures, recordings and journals.

use std::path::Path;

use camera::decode::MAX_SIDE_PX;
use camera::{CameraImage, Encoding, decode, wire};
use ground::clock::MonotonicNs;
use record::journal::{self, Journal};
use record::reader::{Item, Recording};
use record::repair::repair;

/// Lets `what` have a folder of its own, and takes it away.
pub(crate) fn in_a_folder(what: impl FnOnce(&Path) -> bool) -> bool {
    let folder = tempfile::tempdir().unwrap_or_else(|error| panic!("a folder for a target's files: {error}"));
    what(folder.path())
}

/// Writes a file of a target's.
pub(crate) fn put(path: &Path, bytes: &[u8]) {
    std::fs::write(path, bytes).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
}

/// An image as it comes over a socket and out of a recording: sent again it is the same, and its picture is as large as it says.
pub(crate) fn image_message(bytes: &[u8]) -> bool {
    let Ok(image) = wire::decode(bytes) else { return false };
    let sent = [wire::header(&image).as_slice(), &image.data].concat();
    let again = wire::decode(&sent).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((wire::header(&again), &again.data), (wire::header(&image), &image.data));
    shown(&image);
    true
}

fn shown(image: &CameraImage) {
    if let Ok(picture) = decode::picture(image) {
        assert_eq!(picture.grey.dimensions(), (image.width_px, image.height_px));
        for chroma in picture.chroma.iter().flatten() {
            assert_eq!(chroma.dimensions(), picture.grey.dimensions());
        }
    }
}

/// A JPEG or PNG file, and the same bytes as a camera's image in either encoding: no side is longer than allowed.
pub(crate) fn picture(bytes: &[u8]) -> bool {
    let Ok(picture) = decode::picture_file(bytes) else { return false };
    let (width_px, height_px) = picture.grey.dimensions();
    assert!(width_px.max(height_px) <= MAX_SIDE_PX, "{width_px}x{height_px}");
    for encoding in [Encoding::Jpeg, Encoding::Png] {
        let at = MonotonicNs(1);
        let image = CameraImage {
            sequence: 1,
            stamp: at,
            mid_exposure: at,
            damaged: false,
            width_px,
            height_px,
            encoding,
            data: bytes.into(),
        };
        shown(&image);
    }
    true
}

/// What a recording gives, image by image; none where it gives an error.
fn items(path: &Path) -> Option<Vec<String>> {
    let said = |item: Item| match item {
        Item::Image(image) => format!("{:?} {:?}", wire::header(&image), image.data),
        other => format!("{other:?}"),
    };
    let all: Result<Vec<_>, _> = Recording::open(path).ok()?.map(|item| item.map(|(_, item)| item)).collect();
    Some(all.ok()?.into_iter().filter(|item| !matches!(item, Item::Gap)).map(said).collect())
}

/// A recording in any state: its repair takes nothing and adds nothing, and has nothing to do a second time.
pub(crate) fn recording(bytes: &[u8]) -> bool {
    in_a_folder(|folder| {
        let path = folder.join("recording.mcap");
        put(&path, bytes);
        let before = items(&path);
        let Ok(repaired) = repair(&path, None) else { return false };
        let after = items(&path);
        let Some(before) = before else { return false };
        assert_eq!(after.as_ref(), Some(&before), "what a repair leaves; {repaired:?}");
        if !before.is_empty() {
            let again = repair(&path, None).unwrap_or_else(|error| panic!("{error}"));
            assert!(again.was_whole, "repaired twice: {repaired:?}, {again:?}");
        }
        !before.is_empty()
    })
}

/// A journal that somebody goes on writing: what could be read before can be read, and the new line too.
pub(crate) fn journal(bytes: &[u8]) -> bool {
    in_a_folder(|folder| {
        let path = folder.join("journal.jsonl");
        put(&path, bytes);
        let before = journal::read(&path);
        let written = Journal::open(&path, MonotonicNs(0)).and_then(|journal| journal.write("next", ()));
        written.unwrap_or_else(|error| panic!("{error}"));
        match (before, journal::read(&path)) {
            (Ok(before), Ok(after)) => {
                assert_eq!(after[..after.len() - 1], before);
                assert_eq!(after[after.len() - 1].event, "next");
                true
            }
            (Err(_), Err(_)) => false,
            (before, after) => panic!("before: {before:?}\nafter: {after:?}"),
        }
    })
}
