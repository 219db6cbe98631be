//! Draws a mechanism as a camera would see it.
