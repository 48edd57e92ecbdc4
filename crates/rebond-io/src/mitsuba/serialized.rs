//! Mitsuba's own meshes, `.serialized`: several to a file, each deflated, their places in a dictionary at its end.
//!
//! Jakob, "Mitsuba 0.5 documentation" (2014), §8.1.3: versions 3 and 4.

use flate2::read::ZlibDecoder;
use rebond::shape::MeshData;
use std::collections::BTreeMap;
use std::io::Read;

const MAGIC: u16 = 0x041c;
const NORMALS: u32 = 0x1;
const UVS: u32 = 0x2;
const COLORS: u32 = 0x8;
const FACE_NORMALS: u32 = 0x10;
const DOUBLE: u32 = 0x2000;
/// How much larger than the file a mesh may become: vertices compress to a half, but not to this.
const MOST: u64 = 64;

/// Reads one of the meshes.
pub fn read(bytes: &[u8], index: usize) -> Result<MeshData, String> {
    let word = |at: usize| bytes.get(at..at + 2).map(|b| u16::from_le_bytes([b[0], b[1]]));
    let (Some(MAGIC), Some(version @ (3 | 4))) = (word(0), word(2)) else {
        return Err("not a serialized mesh of version 3 or 4".into());
    };
    let short = || "it ends too early".to_string();
    let number = |at: usize, length: usize| -> Option<u64> {
        let end = at.checked_add(length)?;
        Some(bytes.get(at..end)?.iter().rev().fold(0, |n, b| n << 8 | u64::from(*b)))
    };
    let count_at = bytes.len().checked_sub(4).ok_or_else(short)?;
    let count = number(count_at, 4).ok_or_else(short)? as usize;
    if index >= count {
        return Err(format!("it has {count} meshes; shape_index {index} is none of them"));
    }
    let size = if version == 4 { 8 } else { 4 };
    let entry = count.checked_mul(size).and_then(|all| count_at.checked_sub(all)).ok_or_else(short)? + index * size;
    let start = number(entry, size).and_then(|n| usize::try_from(n).ok()).ok_or_else(short)?;
    let packed = bytes.get(start.saturating_add(4)..).filter(|_| word(start) == Some(MAGIC));
    let packed = packed.ok_or_else(|| format!("no mesh is where mesh {index} should be"))?;
    let limit = (bytes.len() as u64).saturating_mul(MOST).max(1 << 20);
    Reader(ZlibDecoder::new(packed).take(limit)).mesh(version, limit)
}

struct Reader<R>(R);

impl<R: Read> Reader<R> {
    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let mut b = [0; N];
        self.0.read_exact(&mut b).map_err(|e| match e.kind() {
            std::io::ErrorKind::UnexpectedEof => "it ends too early, or unpacks to too much".to_string(),
            _ => format!("cannot be unpacked: {e}"),
        })?;
        Ok(b)
    }

    fn real(&mut self, double: bool) -> Result<f32, String> {
        Ok(if double { f64::from_le_bytes(self.bytes()?) as f32 } else { f32::from_le_bytes(self.bytes()?) })
    }

    fn rows<const N: usize>(&mut self, count: u64, double: bool) -> Result<Vec<[f32; N]>, String> {
        // Grows with what is there, not with what the count says.
        let mut rows = Vec::new();
        for _ in 0..count {
            let mut row = [0.0; N];
            for x in &mut row {
                *x = self.real(double)?;
            }
            rows.push(row);
        }
        Ok(rows)
    }

    fn mesh(mut self, version: u16, limit: u64) -> Result<MeshData, String> {
        let flags = u32::from_le_bytes(self.bytes()?);
        if version == 4 {
            // Its name.
            while self.bytes::<1>()? != [0] {}
        }
        let (vertices, triangles) = (u64::from_le_bytes(self.bytes()?), u64::from_le_bytes(self.bytes()?));
        let double = flags & DOUBLE != 0;
        if vertices == 0 || triangles == 0 || vertices > limit / 12 || triangles > limit / 12 {
            return Err(format!("{vertices} vertices and {triangles} triangles do not fit into it"));
        }
        let positions = self.rows::<3>(vertices, double)?;
        let normals = if flags & NORMALS != 0 { Some(self.rows::<3>(vertices, double)?) } else { None };
        let uvs = if flags & UVS != 0 { Some(self.rows::<2>(vertices, double)?) } else { None };
        let mut attributes = BTreeMap::new();
        if flags & COLORS != 0 {
            attributes.insert("vertex_color".into(), self.rows::<3>(vertices, double)?);
        }
        let mut faces = Vec::new();
        for face in 0..triangles {
            let mut corners = [0; 3];
            for c in &mut corners {
                let i = u64::from(u32::from_le_bytes(self.bytes()?));
                if i >= vertices {
                    return Err(format!("triangle {face} names vertex {i} of {vertices}"));
                }
                *c = i as u32;
            }
            faces.push(corners);
        }
        let normals = normals.filter(|_| flags & FACE_NORMALS == 0);
        Ok(MeshData { positions, normals, uvs, triangles: faces, attributes })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::ZlibEncoder;
    use std::io::Write;

    /// A file of these meshes, in single or double precision.
    pub fn write(meshes: &[MeshData], version: u16, double: bool) -> Vec<u8> {
        let (mut out, mut places) = (Vec::new(), Vec::new());
        for mesh in meshes {
            places.push(out.len() as u64);
            out.extend(MAGIC.to_le_bytes());
            out.extend(version.to_le_bytes());
            let mut z = ZlibEncoder::new(Vec::new(), Compression::default());
            let mut put = |b: &[u8]| z.write_all(b).expect("in memory");
            let flags = if double { DOUBLE } else { 0x1000 }
                | if mesh.normals.is_some() { NORMALS } else { 0 }
                | if mesh.uvs.is_some() { UVS } else { 0 };
            put(&flags.to_le_bytes());
            if version == 4 {
                put(b"a name\0");
            }
            put(&(mesh.positions.len() as u64).to_le_bytes());
            put(&(mesh.triangles.len() as u64).to_le_bytes());
            let normals = mesh.normals.iter().flatten().flatten();
            for x in mesh.positions.iter().flatten().chain(normals).chain(mesh.uvs.iter().flatten().flatten()) {
                match double {
                    true => put(&f64::from(*x).to_le_bytes()),
                    false => put(&x.to_le_bytes()),
                }
            }
            mesh.triangles.iter().flatten().for_each(|i| put(&i.to_le_bytes()));
            out.extend(z.finish().expect("in memory"));
        }
        for place in places {
            match version {
                4 => out.extend(place.to_le_bytes()),
                _ => out.extend((place as u32).to_le_bytes()),
            }
        }
        out.extend((meshes.len() as u32).to_le_bytes());
        out
    }

    fn quad() -> MeshData {
        MeshData {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5], [0.0, 1.0, 0.25]],
            normals: Some(vec![[0.0, 0.0, 1.0]; 4]),
            uvs: Some(vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..MeshData::default()
        }
    }

    #[test]
    fn meshes_come_back() {
        let plain = MeshData { normals: None, uvs: None, ..quad() };
        for (version, double) in [(3, false), (4, false), (4, true)] {
            let file = write(&[quad(), plain.clone()], version, double);
            assert_eq!(read(&file, 0), Ok(quad()));
            assert_eq!(read(&file, 1), Ok(plain.clone()));
            assert_eq!(read(&file, 2), Err("it has 2 meshes; shape_index 2 is none of them".into()));
            for cut in 0..file.len() {
                let _ = read(&file[..cut], 0);
            }
            let cut = [&file[..40], &file[file.len() - 20..]].concat();
            assert!(read(&cut, 0).is_err());
        }
        assert!(read(b"ply", 0).is_err());
    }

    #[test]
    fn bombs_do_not_go_off() {
        // A million triangles of zeros deflate to a thousandth.
        let mesh =
            MeshData { positions: vec![[0.0; 3]; 1 << 20], triangles: vec![[0; 3]; 1 << 20], ..MeshData::default() };
        let file = write(&[mesh], 4, false);
        assert!(file.len() < 1 << 16);
        let error = read(&file, 0).unwrap_err();
        assert!(error.contains("do not fit"), "{error}");
    }
}
