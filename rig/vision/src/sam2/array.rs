//! Numbers with a shape, as they go into graphs and come out.

/// 32 bit numbers with sizes, the slowest first.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Array {
    pub(super) shape: Vec<usize>,
    pub(super) values: Vec<f32>,
}

impl Array {
    /// `values` in the given shape.
    pub(super) fn new(shape: impl Into<Vec<usize>>, values: Vec<f32>) -> Self {
        let shape = shape.into();
        debug_assert_eq!(shape.iter().product::<usize>(), values.len());
        Self { shape, values }
    }

    /// One number of shape \[1\].
    pub(super) fn one(value: f32) -> Self {
        Self::new([1], vec![value])
    }
}
