//! OpenEXR images of 32-bit numbers, not compressed.

use std::path::Path;

use anyhow::{Context, Result};
use exr::prelude::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage as _};

/// Writes channels (name and row-major values, one a pixel) of an image `width` pixels wide.
pub fn write(path: &Path, width: usize, channels: &[(&str, Vec<f32>)]) -> Result<()> {
    let height = channels.first().map_or(0, |(_, values)| values.len() / width.max(1));
    let channels =
        channels.iter().map(|(name, values)| AnyChannel::new(*name, FlatSamples::F32(values.clone()))).collect();
    let layer =
        Layer::new((width, height), LayerAttributes::default(), Encoding::UNCOMPRESSED, AnyChannels::sort(channels));
    Image::from_layer(layer).write().non_parallel().to_file(path).with_context(|| path.display().to_string())
}

#[cfg(test)]
mod tests {
    use exr::prelude::{ReadChannels as _, ReadLayers as _, read};

    use super::*;

    #[test]
    fn channels_are_read_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("image.exr");
        let (width, height) = (5, 3);
        let values = |k: usize| (0..width * height).map(|i| (10 * k + i) as f32 / 7.0).collect::<Vec<f32>>();
        write(&path, width, &[("R", values(1)), ("G", values(2))]).expect("written");
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_file(&path)
            .expect("read");
        let layer = image.layer_data;
        assert_eq!((layer.size.x(), layer.size.y()), (width, height));
        let found: Vec<(String, Vec<f32>)> = layer
            .channel_data
            .list
            .iter()
            .map(|channel| (channel.name.to_string(), channel.sample_data.values_as_f32().collect()))
            .collect();
        assert_eq!(found, [("G".to_owned(), values(2)), ("R".to_owned(), values(1))]);
    }
}
