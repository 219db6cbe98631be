//! Builds the book of `docs/` into `book/`, without anything to install: `cargo run -p system-tests --example book`.

#![allow(clippy::print_stdout, reason = "its output is the point")]

use mdbook_driver::MDBook;
use system_tests::repository;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let book = MDBook::load(repository().join("docs"))?;
    book.build()?;
    let index = book.build_dir_for("html").join("index.html").canonicalize()?;
    println!("file://{}", index.display());
    Ok(())
}
