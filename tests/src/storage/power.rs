//! What a power cut leaves: POSIX promises bytes of a file only when the file was synced after them, and a name only when its folder
//! was. Whatever else was done may be there or not, and the last write may be there in part.

use std::collections::BTreeMap;
use std::path::Path;

use super::Event;

/// Which of what was not synced is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Left {
    /// Names of files whose folders were not synced: new ones, other ones, and their going.
    pub names: bool,
    /// Bytes of files that were not synced; of the last write only the first half.
    pub bytes: bool,
}

impl Left {
    /// Each of both, or not.
    pub const ALL: [Self; 4] = [
        Self { names: false, bytes: false },
        Self { names: false, bytes: true },
        Self { names: true, bytes: false },
        Self { names: true, bytes: true },
    ];
}

/// What there is now, and what a power cut leaves of it for sure.
#[derive(Debug, Clone, Default)]
struct Both<T> {
    now: T,
    synced: T,
}

#[derive(Debug, Clone)]
enum Node {
    File(Both<Vec<u8>>),
    Folder(Both<BTreeMap<String, usize>>),
}

/// The files of a folder, as events change them.
#[derive(Debug, Clone)]
pub struct Disk {
    nodes: Vec<Node>,
    /// The last write: in which file, from where, how many bytes.
    last: Option<(usize, usize, usize)>,
}

impl Default for Disk {
    /// An empty folder.
    fn default() -> Self {
        Self { nodes: vec![Node::Folder(Both::default())], last: None }
    }
}

impl Disk {
    fn folder(&mut self, node: usize) -> &mut Both<BTreeMap<String, usize>> {
        match &mut self.nodes[node] {
            Node::Folder(names) => names,
            Node::File(_) => panic!("a file is no folder"),
        }
    }

    fn find(&mut self, path: &Path) -> Option<usize> {
        path.iter().try_fold(0, |node, part| self.folder(node).now.get(part.to_str()?).copied())
    }

    /// The folder that `path` is in, and its name in it.
    fn place(&mut self, path: &Path) -> (usize, String) {
        let above = self
            .find(path.parent().expect("a folder above"))
            .unwrap_or_else(|| panic!("no folder of {path:?}"));
        (above, path.file_name().and_then(|name| name.to_str()).expect("a name").to_owned())
    }

    fn add(&mut self, path: &Path, node: Node) {
        if path.as_os_str().is_empty() {
            return;
        }
        let (above, name) = self.place(path);
        self.nodes.push(node);
        let new = self.nodes.len() - 1;
        self.folder(above).now.insert(name, new);
    }

    fn file(&mut self, path: &Path) -> (usize, &mut Both<Vec<u8>>) {
        let node = self.find(path).unwrap_or_else(|| panic!("no file {path:?}"));
        match &mut self.nodes[node] {
            Node::File(bytes) => (node, bytes),
            Node::Folder(_) => panic!("{path:?} is a folder"),
        }
    }

    /// Takes in what happened next. What SQLite shares between processes in `-shm` files is made anew by whoever comes next.
    pub fn happens(&mut self, event: &Event) {
        if event.path.to_string_lossy().ends_with("-shm") || event.done != "done" {
            return;
        }
        self.last = None;
        let path = &event.path;
        match event.kind.as_str() {
            "create" => self.add(path, Node::File(Both::default())),
            "make-folder" => self.add(path, Node::Folder(Both::default())),
            "write" => {
                let (from, to) = (event.offset as usize, event.offset as usize + event.data.len());
                let (node, bytes) = self.file(path);
                bytes.now.resize(bytes.now.len().max(to), 0);
                bytes.now[from..to].copy_from_slice(&event.data);
                self.last = Some((node, from, event.data.len()));
            }
            "set-length" => self.file(path).1.now.resize(event.length as usize, 0),
            "sync" => {
                let (_, bytes) = self.file(path);
                bytes.synced.clone_from(&bytes.now);
            }
            "sync-folder" => {
                let node = self.find(path).expect("a folder");
                let names = self.folder(node);
                names.synced.clone_from(&names.now);
            }
            "remove" => {
                let (above, name) = self.place(path);
                self.folder(above).now.remove(&name);
            }
            "rename" => {
                let (from, old) = self.place(path);
                let node = self.folder(from).now.remove(&old).expect("what is renamed");
                let (to, new) = self.place(&event.path2);
                self.folder(to).now.insert(new, node);
            }
            other => panic!("an event of the kind {other}"),
        }
    }

    /// Writes to `folder`, which is empty, what a power cut now would leave.
    pub fn cut(&self, left: Left, folder: &Path) {
        self.write(0, left, folder);
    }

    fn write(&self, node: usize, left: Left, path: &Path) {
        match &self.nodes[node] {
            Node::File(bytes) => {
                let mut there = if left.bytes { bytes.now.clone() } else { bytes.synced.clone() };
                if let Some((_, from, length)) = self.last.filter(|last| left.bytes && last.0 == node) {
                    // in the middle of a file what was there before is not known to be there any more
                    let torn = from + length / 2;
                    let end = from + length;
                    if end == there.len() { there.truncate(torn) } else { there[torn..end].fill(0) }
                }
                std::fs::write(path, there).expect("written");
            }
            Node::Folder(names) => {
                std::fs::create_dir_all(path).expect("a folder");
                for (name, node) in if left.names { &names.now } else { &names.synced } {
                    self.write(*node, left, &path.join(name));
                }
            }
        }
    }
}
