//! Style of the page and of its figures: one palette, light and dark, for both.

/// Palette and rules of figures. It is included once in the page, and in every standalone figure.
pub const FIGURE_CSS: &str = include_str!("../data/figure.css");

/// Rules of the page only.
pub const PAGE_CSS: &str = include_str!("../data/page.css");
