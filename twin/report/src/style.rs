//! The look of the page and of its figures: one palette, light and dark, for both.

/// The palette, and what only figures need. Goes into the page once and into every figure that stands alone.
pub const FIGURE: &str = include_str!("../data/figure.css");

/// What only the page needs.
pub const PAGE: &str = include_str!("../data/page.css");
