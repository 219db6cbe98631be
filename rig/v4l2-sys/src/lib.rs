//! The Video4Linux2 types that the crate `v4l` 0.14 uses, in place of `v4l2-sys-mit` 0.3.0, which generates them
//! at build time and so makes every build need libclang.
//!
//! `bindings.rs` was generated once, with bindgen 0.72.1 and clang 14, from `linux/videodev2.h` of Linux 6.1:
//!
//! ```text
//! bindgen wrapper.h --use-core --no-layout-tests --no-doc-comments --no-derive-debug \
//!     --allowlist-type "$TYPES" --allowlist-var 'V4L2_CTRL_FLAG_NEXT_.*' \
//!     --opaque-type 'v4l2_ctrl_.*' --opaque-type v4l2_area -- --target=$TARGET
//! ```
//!
//! where `wrapper.h` includes that header, and `$TYPES` are the structures that `v4l` names (its
//! `v4l2/vidioc.rs` lists them). For the targets `x86_64-linux-gnu`, `aarch64-linux-gnu` and `arm-linux-gnueabihf`, each
//! with its own headers (Debian's `linux-libc-dev` and `linux-libc-dev-{arm64,armhf}-cross`), the output is the same
//! to the byte: widths and padding follow from `c_long` and from pointers. So one file serves all of them, and the
//! sizes below, which the ioctl numbers of the kernel contain, are checked on whatever target is built for.
//!
//! Codec controls are opaque: `v4l` only ever holds pointers to them.

#[allow(missing_docs, non_camel_case_types, non_snake_case, non_upper_case_globals, clippy::all)]
mod bindings;

pub use bindings::*;

/// Fails the build where a structure has another size than the kernel's.
macro_rules! assert_size {
    ($($type:ident: $on_64_bit:literal, $on_32_bit:literal;)*) => {$(
        const _: () = assert!(
            size_of::<$type>() == if cfg!(target_pointer_width = "64") { $on_64_bit } else { $on_32_bit }
        );
    )*};
}

assert_size! {
    v4l2_capability: 104, 104;
    v4l2_fmtdesc: 64, 64;
    v4l2_format: 208, 204;
    v4l2_requestbuffers: 20, 20;
    v4l2_buffer: 88, 68;
    v4l2_streamparm: 204, 204;
    v4l2_ext_control: 20, 20;
    v4l2_ext_controls: 32, 24;
    v4l2_query_ext_ctrl: 232, 232;
    v4l2_querymenu: 44, 44;
    v4l2_frmsizeenum: 44, 44;
    v4l2_frmivalenum: 52, 52;
}
