//! Images: named layers of named channels.

/// What a film develops to and what image files hold.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Image {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Layers, the picture itself first (its name is empty).
    pub layers: Vec<Layer>,
}

/// One layer of an image, such as the picture, its variance or its sample counts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layer {
    /// Name; empty for the picture itself.
    pub name: String,
    /// Channels in order.
    pub channels: Vec<Channel>,
}

/// One number per pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Channel {
    /// Name, such as `R`.
    pub name: String,
    /// Values, row by row from the top left.
    pub data: Vec<f32>,
}

impl Image {
    /// An image of one colour layer from linear RGB pixels, row by row from the top left.
    ///
    /// # Panics
    /// If there are not `width · height` pixels.
    pub fn from_rgb(width: u32, height: u32, pixels: &[[f32; 3]]) -> Self {
        assert_eq!(pixels.len(), width as usize * height as usize);
        Self { width, height, layers: vec![Layer::rgb("", pixels)] }
    }

    /// The layer of that name.
    pub fn layer(&self, name: &str) -> Option<&Layer> {
        self.layers.iter().find(|l| l.name == name)
    }

    /// The colours of a layer: R, G, B by name, or its only channel three times.
    pub fn rgb(&self, layer: &str) -> Option<Vec<[f32; 3]>> {
        let layer = self.layer(layer)?;
        let one = |name: &str| layer.channels.iter().find(|c| c.name == name);
        let [r, g, b] = match (one("R"), one("G"), one("B"), &layer.channels[..]) {
            (Some(r), Some(g), Some(b), _) => [r, g, b],
            (_, _, _, [only]) => [only; 3],
            _ => return None,
        };
        Some((0..r.data.len()).map(|i| [r.data[i], g.data[i], b.data[i]]).collect())
    }
}

impl Layer {
    /// A layer of the channels R, G, B.
    pub fn rgb(name: &str, pixels: &[[f32; 3]]) -> Self {
        let channels = ["R", "G", "B"].iter().enumerate();
        let channel =
            |(i, c): (usize, &&str)| Channel { name: c.to_string(), data: pixels.iter().map(|p| p[i]).collect() };
        Self { name: name.into(), channels: channels.map(channel).collect() }
    }
}
