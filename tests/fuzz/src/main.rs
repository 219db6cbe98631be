//! A target under libFuzzer, which follows the code that its inputs reach; `scripts/fuzz TARGET` builds and starts it.

#![cfg_attr(feature = "libfuzzer", no_main)]

#[cfg(feature = "libfuzzer")]
#[allow(unsafe_code, reason = "libFuzzer is C++ and calls in")]
mod engine {
    use std::sync::LazyLock;

    /// The target that the environment names: libFuzzer has the arguments for itself.
    static TARGET: LazyLock<fuzz::Target> = LazyLock::new(|| {
        let name = std::env::var("RIG_FUZZ_TARGET").unwrap_or_default();
        fuzz::target(&name).unwrap_or_else(|| {
            eprintln!("RIG_FUZZ_TARGET={name} names no target; those there are: {}", fuzz::names());
            std::process::exit(2)
        })
    });

    libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
        (TARGET.meets)(bytes);
    });
}

#[cfg(not(feature = "libfuzzer"))]
fn main() -> std::process::ExitCode {
    eprintln!("built without its engine; `scripts/fuzz TARGET` builds it with one, of: {}", fuzz::names());
    std::process::ExitCode::from(2)
}
