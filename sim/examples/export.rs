//! MJCF from standard input, read and written again to standard output: what `tests/data/check_exports.py` puts before MuJoCo.
#![allow(clippy::print_stdout, reason = "its output is the point")]

use sim::Model;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let text = std::io::read_to_string(std::io::stdin())?;
    print!("{}", Model::from_mjcf(&text)?.to_mjcf("exported for a comparison"));
    Ok(())
}
