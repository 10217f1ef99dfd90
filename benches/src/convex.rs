//! Minimisation by plain search, as a reference.

/// The min of a convex function on `[0, 1]`.
pub fn min_of_convex(f: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let third = (high - low) / 3.0;
        if f(low + third) < f(high - third) { high -= third } else { low += third }
    }
    f((low + high) * 0.5)
}
