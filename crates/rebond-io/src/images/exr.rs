//! OpenEXR. All layers are written into one part, other layers' channels as `layer.R`: every viewer then opens the
//! picture, and every reader that knows layers (OpenEXR's own tools, Mitsuba's `Bitmap.split`, Blender, tev) finds the
//! others. Read are also files of several parts, a layer each.

use super::check_size;
use exr::meta::attribute::LineOrder;
use exr::prelude::{
    AnyChannel, AnyChannels, Compression, Encoding, FlatSamples, Image as ExrImage, Layer as ExrLayer, LayerAttributes,
    MetaData, ReadChannels, ReadLayers, Text, WritableImage,
};
use rebond::film::{Channel, Image, Layer};
use std::io::Cursor;

pub(super) fn read(bytes: &[u8]) -> Result<Image, String> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(|e| e.to_string())?;
    for header in &meta.headers {
        if header.deep {
            return Err("deep images are not supported".into());
        }
        check_size(header.layer_size.width(), header.layer_size.height(), header.channels.list.len(), bytes)?;
    }
    let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().all_layers();
    let file = reader.all_attributes().non_parallel().from_buffered(Cursor::new(bytes)).map_err(|e| e.to_string())?;
    let Some(first) = file.layer_data.first() else { return Err("it has no layers".into()) };
    let size = first.size;
    let (width, height) = match (u32::try_from(size.width()), u32::try_from(size.height())) {
        (Ok(width), Ok(height)) => (width, height),
        _ => return Err("it is too large".into()),
    };
    let mut layers: Vec<Layer> = Vec::new();
    for (index, part) in file.layer_data.into_iter().enumerate() {
        if part.size != size {
            return Err("its parts differ in size".into());
        }
        let part_name = part.attributes.layer_name.filter(|_| index > 0).map_or(String::new(), |n| n.to_string());
        for channel in part.channel_data.list {
            let full_name = channel.name.to_string();
            let (layer, name) = match full_name.rsplit_once('.') {
                Some((layer, name)) => (layer, name),
                None => (&*part_name, &*full_name),
            };
            let data = match channel.sample_data {
                FlatSamples::F32(values) => values,
                other => other.values_as_f32().collect(),
            };
            if data.len() != width as usize * height as usize {
                return Err(format!("its channel {full_name} is subsampled"));
            }
            let channel = Channel { name: name.to_string(), data };
            match layers.iter_mut().find(|l| l.name == layer) {
                Some(layer) => layer.channels.push(channel),
                None => layers.push(Layer { name: layer.to_string(), channels: vec![channel] }),
            }
        }
    }
    // The file has them in alphabetical order; the picture comes first, and R before G before B.
    layers.sort_by_key(|l| !l.name.is_empty());
    for layer in &mut layers {
        layer.channels.sort_by_key(|c| "RGBA".find(&*c.name).unwrap_or(usize::MAX));
    }
    Ok(Image { width, height, layers })
}

pub(super) fn write(image: &Image) -> Result<Vec<u8>, String> {
    let mut channels = Vec::new();
    for layer in &image.layers {
        for channel in &layer.channels {
            let name = match &*layer.name {
                "" => channel.name.clone(),
                layer => format!("{layer}.{}", channel.name),
            };
            let text = Text::new_or_none(&name).filter(|_| !name.is_empty());
            let text = text.ok_or_else(|| format!("\"{name}\" cannot name a channel"))?;
            if channels.iter().any(|c: &AnyChannel<_>| c.name == text) {
                return Err(format!("there are two channels {name}"));
            }
            channels.push(AnyChannel::new(text, FlatSamples::F32(channel.data.clone())));
        }
    }
    if channels.is_empty() {
        return Err("there are no channels".into());
    }
    let attributes = LayerAttributes { software_name: Some(Text::from("rebond")), ..LayerAttributes::default() };
    // Lines in order: the same picture is the same file.
    let line_order = LineOrder::Increasing;
    let encoding = Encoding { compression: Compression::ZIP16, line_order, ..Encoding::FAST_LOSSLESS };
    let size = (image.width as usize, image.height as usize);
    let layer = ExrLayer::new(size, attributes, encoding, AnyChannels::sort(channels.into()));
    let mut bytes = Cursor::new(Vec::new());
    ExrImage::from_layer(layer).write().to_buffered(&mut bytes).map_err(|e| e.to_string())?;
    Ok(bytes.into_inner())
}
