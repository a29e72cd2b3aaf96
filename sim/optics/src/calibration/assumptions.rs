//! Parts of the image-formation model that a fit uses.

/// Assumptions of a fit. Each flag that is false leaves out a part of the model, as an ablation does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assumptions {
    /// Size of a pixel on the gel (m); `None` if it is to be fitted. A ball's shading hardly distinguishes scale from
    /// steepness, so a known pixel size should be given; the coating's thickness is fitted only then.
    pub pixel: Option<f64>,
    /// Cubic camera response; linear otherwise.
    pub response: bool,
    /// Rough coating (Oren and Nayar); Lambertian otherwise.
    pub oren_nayar: bool,
    /// Near-field lamps; parallel light otherwise.
    pub near_field: bool,
    /// Cast shadows.
    pub shadows: bool,
}

impl Assumptions {
    /// Returns the full model.
    pub fn full(pixel: Option<f64>) -> Self {
        Self { pixel, response: true, oren_nayar: true, near_field: true, shadows: true }
    }

    /// Returns the full model and each ablation of one part, with names.
    pub fn ablations(pixel: Option<f64>) -> [(&'static str, Self); 5] {
        let full = Self::full(pixel);
        [
            ("full model", full),
            ("linear response", Self { response: false, ..full }),
            ("Lambert", Self { oren_nayar: false, ..full }),
            ("far lamps", Self { near_field: false, ..full }),
            ("no shadows", Self { shadows: false, ..full }),
        ]
    }
}
