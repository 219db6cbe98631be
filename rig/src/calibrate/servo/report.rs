//! A servo's calibration for people, and the file of it.
