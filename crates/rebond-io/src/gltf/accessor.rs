//! Accessors: rows of numbers in the buffers of a file, dense or sparse, whole numbers of any size or f32.

use super::{Importer, Result};
use crate::error::Error;
use ::gltf::json::accessor::{Accessor, ComponentType, Type};
use ::gltf::json::validation::Checked;
use base64::Engine as _;
use std::rc::Rc;

/// Rows of a file's accessors without a buffer, which are zeros.
const MOST_ZEROS: u64 = 1 << 20;

/// What an accessor holds.
pub struct Numbers {
    /// All values, one row after the other; normalised if the accessor says so.
    pub values: Vec<f32>,
    /// The same as whole numbers, if they are.
    pub indices: Vec<u32>,
    width: usize,
}

impl Numbers {
    /// How many rows.
    pub fn len(&self) -> usize {
        self.values.len() / self.width
    }

    /// How many numbers to a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// A row of N numbers.
    pub fn row<const N: usize>(&self, i: usize) -> [f32; N] {
        std::array::from_fn(|c| self.values[i * N + c])
    }
}

/// Bytes of a number, by type.
fn size(kind: ComponentType) -> usize {
    match kind {
        ComponentType::I8 | ComponentType::U8 => 1,
        ComponentType::I16 | ComponentType::U16 => 2,
        ComponentType::U32 | ComponentType::F32 => 4,
    }
}

/// A number as it is, and as a whole one.
fn read(bytes: &[u8], kind: ComponentType, normalized: bool) -> (f32, u32) {
    let scaled = |x: f32, largest: f32| if normalized { (x / largest).max(-1.0) } else { x };
    match (kind, bytes) {
        (ComponentType::I8, &[a]) => (scaled(f32::from(a as i8), 127.0), 0),
        (ComponentType::U8, &[a]) => (scaled(f32::from(a), 255.0), u32::from(a)),
        (ComponentType::I16, &[a, b]) => (scaled(f32::from(i16::from_le_bytes([a, b])), 32767.0), 0),
        (ComponentType::U16, &[a, b]) => {
            let x = u16::from_le_bytes([a, b]);
            (scaled(f32::from(x), 65535.0), u32::from(x))
        }
        (ComponentType::U32, &[a, b, c, d]) => {
            let x = u32::from_le_bytes([a, b, c, d]);
            (x as f32, x)
        }
        (ComponentType::F32, &[a, b, c, d]) => (f32::from_le_bytes([a, b, c, d]), 0),
        _ => (0.0, 0),
    }
}

impl Importer<'_> {
    /// An accessor that has rows of `width` numbers.
    pub fn rows(&mut self, number: usize, width: usize, path: &str) -> Result<Rc<Numbers>> {
        let numbers = self.accessor(number, path)?;
        if numbers.width != width {
            let message = format!("accessor {number} has rows of {} numbers, not {width}", numbers.width);
            return Err(self.error(path, message));
        }
        Ok(numbers)
    }

    /// Whole numbers, one to a row.
    pub fn indices(&mut self, number: usize, path: &str) -> Result<Rc<Numbers>> {
        let numbers = self.accessor(number, path)?;
        let kind = self.root.accessors.get(number).map(|a| a.component_type);
        match kind {
            Some(Checked::Valid(kind))
                if numbers.width == 1
                    && matches!(kind.0, ComponentType::U8 | ComponentType::U16 | ComponentType::U32) =>
            {
                Ok(numbers)
            }
            _ => Err(self.error(path, format!("accessor {number} has no whole numbers, one to a row, for indices"))),
        }
    }

    /// All numbers of an accessor, which is read once.
    pub fn accessor(&mut self, number: usize, path: &str) -> Result<Rc<Numbers>> {
        if let Some(known) = self.accessors.get(&number) {
            return Ok(known.clone());
        }
        let place = format!("accessors[{number}]");
        let Some(a) = self.root.accessors.get(number).cloned() else {
            return Err(self.error(path, format!("there is no accessor {number}")));
        };
        let (Checked::Valid(kind), Checked::Valid(shape)) = (a.component_type, a.type_) else {
            return Err(self.error(&place, "it is of no known type"));
        };
        let width = match shape {
            Type::Scalar => 1,
            Type::Vec2 => 2,
            Type::Vec3 => 3,
            Type::Vec4 => 4,
            Type::Mat2 | Type::Mat3 | Type::Mat4 => return Err(self.error(&place, "matrices mean nothing here")),
        };
        let count = a.count.0;
        let mut numbers = match a.buffer_view {
            Some(view) => {
                let (bytes, stride) = self.view(view.value(), a.byte_offset.map_or(0, |o| o.0))?;
                dense(bytes, stride, count, width, kind.0, a.normalized).map_err(|m| self.error(&place, m))?
            }
            None if self.zeros.saturating_add(count) <= MOST_ZEROS => {
                self.zeros += count;
                let n = count as usize * width;
                Numbers { values: vec![0.0; n], indices: vec![0; n], width }
            }
            None => return Err(self.error(&place, format!("rows of zeros are more than {MOST_ZEROS}"))),
        };
        self.sparse(&a, &mut numbers, kind.0).map_err(|e| match e.path.is_empty() {
            true => self.error(&place, e.message),
            false => e,
        })?;
        self.count(&place, numbers.values.len() as u64)?;
        let numbers = Rc::new(numbers);
        self.accessors.insert(number, numbers.clone());
        Ok(numbers)
    }

    fn sparse(&mut self, a: &Accessor, numbers: &mut Numbers, kind: ComponentType) -> Result<()> {
        let Some(sparse) = &a.sparse else { return Ok(()) };
        let (count, width) = (sparse.count.0, numbers.width);
        let Checked::Valid(index_kind) = sparse.indices.component_type else {
            return Err(Error::new("its sparse indices are of no known type"));
        };
        let (bytes, _) = self.view(sparse.indices.buffer_view.value(), sparse.indices.byte_offset.0)?;
        let places = dense(bytes, None, count, 1, index_kind.0, false).map_err(Error::new)?.indices;
        let (bytes, _) = self.view(sparse.values.buffer_view.value(), sparse.values.byte_offset.0)?;
        let values = dense(bytes, None, count, width, kind, a.normalized).map_err(Error::new)?;
        for (i, place) in places.into_iter().enumerate() {
            let start = place as usize * width;
            let Some(target) = numbers.values.get_mut(start..start + width) else {
                return Err(Error::new(format!("row {place} of its sparse values is none of its rows")));
            };
            target.copy_from_slice(&values.values[i * width..(i + 1) * width]);
            numbers.indices[start..start + width].copy_from_slice(&values.indices[i * width..(i + 1) * width]);
        }
        Ok(())
    }

    /// The bytes of a view from an offset on, and how far apart its rows are.
    fn view(&mut self, number: usize, offset: u64) -> Result<(&[u8], Option<usize>)> {
        let path = format!("bufferViews[{number}]");
        let Some(view) = self.root.buffer_views.get(number) else {
            return Err(self.error(&path, "there is no such view"));
        };
        let (buffer, length, stride) = (view.buffer.value(), view.byte_length.0, view.byte_stride.map(|s| s.0));
        let start = view.byte_offset.map_or(0, |o| o.0);
        self.load(buffer)?;
        let bytes = match (self.buffers.get(&buffer), self.bin) {
            (Some(bytes), _) => bytes,
            (None, Some(bin)) => bin,
            (None, None) => &[],
        };
        let range = || {
            let end = usize::try_from(start.checked_add(length)?).ok()?;
            bytes.get(usize::try_from(start).ok()?..end)?.get(usize::try_from(offset).ok()?..)
        };
        match range() {
            Some(bytes) => Ok((bytes, stride)),
            None => Err(self.error(&path, format!("it reaches beyond the {} bytes of its buffer", bytes.len()))),
        }
    }

    /// All bytes of a view.
    pub fn view_bytes(&mut self, number: usize) -> Result<Vec<u8>> {
        self.view(number, 0).map(|(bytes, _)| bytes.to_vec())
    }

    fn load(&mut self, number: usize) -> Result<()> {
        if self.buffers.contains_key(&number) {
            return Ok(());
        }
        let path = format!("buffers[{number}]");
        let Some(buffer) = self.root.buffers.get(number) else {
            return Err(self.error(&path, "there is no such buffer"));
        };
        match buffer.uri.clone() {
            Some(uri) => {
                let bytes = self.open(&uri).map_err(|m| self.error(&path, m))?;
                self.bytes += bytes.len() as u64;
                self.buffers.insert(number, bytes);
            }
            // The binary chunk.
            None if number == 0 && self.bin.is_some() => {}
            None => return Err(self.error(&path, "it has no bytes")),
        }
        Ok(())
    }

    /// What a URI holds: data in place, or a file.
    pub fn open(&self, uri: &str) -> Result<Vec<u8>, String> {
        if let Some(data) = uri.strip_prefix("data:") {
            let encoded = data.split_once(";base64,").map(|(_, text)| text).ok_or("data that is not base64")?;
            let engine = base64::engine::general_purpose::STANDARD;
            return engine.decode(encoded).map_err(|e| format!("data that is not base64: {e}"));
        }
        if uri.contains("://") {
            return Err(format!("\"{uri}\" is not a file"));
        }
        self.assets.read(&unescape(uri))
    }
}

/// `%20` as a space, and so on.
pub fn unescape(uri: &str) -> String {
    let mut out = Vec::new();
    let bytes = uri.as_bytes();
    let mut i = 0;
    while i < bytes.len() {
        let code = bytes.get(i + 1..i + 3).and_then(|hex| std::str::from_utf8(hex).ok());
        match code.and_then(|hex| u8::from_str_radix(hex, 16).ok()).filter(|_| bytes[i] == b'%') {
            Some(byte) => {
                out.push(byte);
                i += 3;
            }
            None => {
                out.push(bytes[i]);
                i += 1;
            }
        }
    }
    String::from_utf8_lossy(&out).into_owned()
}

fn dense(
    bytes: &[u8],
    stride: Option<usize>,
    count: u64,
    width: usize,
    kind: ComponentType,
    normalized: bool,
) -> Result<Numbers, String> {
    let (count, row) = (usize::try_from(count).map_err(|_| "it is too long")?, width * size(kind));
    let stride = stride.filter(|s| *s > 0).unwrap_or(row);
    // The last row need not be followed by a gap.
    let needed = count.checked_sub(1).map_or(Some(0), |n| n.checked_mul(stride)?.checked_add(row));
    if needed.is_none_or(|n| n > bytes.len()) || stride < row {
        return Err(format!("{count} rows do not fit into the {} bytes of its view", bytes.len()));
    }
    let mut numbers =
        Numbers { values: Vec::with_capacity(count * width), indices: Vec::with_capacity(count * width), width };
    for i in 0..count {
        for number in bytes[i * stride..i * stride + row].chunks_exact(size(kind)) {
            let (value, index) = read(number, kind, normalized);
            numbers.values.push(value);
            numbers.indices.push(index);
        }
    }
    Ok(numbers)
}
