//! A scene as a list of flat faces and their diffuse reflectance: what algorithms see that divide surfaces instead of
//! tracing paths over them.

use super::varied::Place;
use super::{BUMP_MAP, HAS_UVS, MASK, MATERIAL_RECORDS, MIX, NORMAL_MAP, Scene, TWO_SIDED};
use crate::bsdf::{Lobe, Model, PARAMETERS};
use crate::emitter::NO_EMITTER;
use crate::math::Rgb;
use glam::{DAffine3, DMat3, DVec3};
use rebond_lanes::{Real, Record, scalar::Index1};

/// Names of what a scene is made of, for messages.
#[derive(Clone, Debug, Default)]
pub(super) struct Names {
    /// Of each shape, as in `shapes[3]`.
    pub shapes: Vec<String>,
    /// Of materials that have one.
    pub materials: Vec<(u32, String)>,
    /// Of each instance.
    pub instances: Vec<String>,
}

/// Primitives of an instance: the first, how many are triangles, and how many there are.
pub(super) type Extent = [u32; 3];

/// One side of a triangle, counter-clockwise seen from that side.
#[derive(Clone, Debug)]
pub struct Face {
    /// Corners.
    pub corners: [DVec3; 3],
    /// Texture coordinates at the corners.
    pub uv: [[f32; 2]; 3],
    /// Instance it belongs to, as [`rebond_bvh::Hit`] counts.
    pub instance: u32,
    /// Primitive it is a side of.
    pub primitive: u32,
    /// Whether it is the side against the normal, of a two-sided material.
    pub behind: bool,
    /// Number of its shape.
    pub shape: u32,
    /// Its material.
    pub material: u32,
    /// Radiance it emits.
    pub emission: [f32; 3],
}

/// Something that is no diffuse face at rest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Obstacle {
    /// Where in the description, and the material's name if it has one.
    pub place: String,
    /// What it is.
    pub what: String,
    /// Whether something is left if its specular part is dropped.
    pub has_diffuse_part: bool,
}

/// What a material reflects diffusely.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiffusePart {
    /// ρ.
    pub reflectance: [f32; 3],
    /// Whether that is all it does.
    pub whole: bool,
}

impl Scene {
    /// What the scene's description calls a shape.
    pub fn shape_name(&self, shape: u32) -> &str {
        self.names.shapes.get(shape as usize).map_or("", String::as_str)
    }

    /// How many shapes there are.
    pub fn shape_count(&self) -> u32 {
        self.names.shapes.len() as u32
    }

    /// How many instances there are, the scene itself being the first.
    pub fn instance_count(&self) -> u32 {
        self.extents.len() as u32
    }

    /// First primitive of an instance, and how many triangles it has.
    pub fn triangles_of(&self, instance: u32) -> [u32; 2] {
        let [first, triangles, _] = self.extents[instance as usize];
        [first, triangles]
    }

    /// All sides of triangles that reflect or shine.
    pub fn faces(&self) -> Vec<Face> {
        let mut faces = Vec::new();
        for (instance, [first, triangles, _]) in self.extents.iter().enumerate() {
            let matrix = self.instance_matrix(instance as u32);
            for primitive in *first..first + triangles {
                self.faces_of(instance as u32, primitive, &matrix, &mut faces);
            }
        }
        faces
    }

    fn faces_of(&self, instance: u32, primitive: u32, matrix: &DAffine3, faces: &mut Vec<Face>) {
        let corners = f32::words(&self.primitives, Index1(primitive));
        let [material, first_emitter, flags, first_primitive] = f32::words(&self.shapes, corners[3]).map(|w| w.0);
        let mut uv = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        let points = [0, 1, 2].map(|k| {
            let Record([x, y, z, u]) = self.vertices[corners[k].0 as usize];
            if flags & HAS_UVS != 0 {
                uv[k] = [u, self.normals[corners[k].0 as usize].0[3]];
            }
            matrix.transform_point3(DVec3::new(x.into(), y.into(), z.into()))
        });
        let area = (points[1] - points[0]).cross(points[2] - points[0]).length();
        if !(area.is_finite() && area > 0.0) {
            return;
        }
        let emitter = match first_emitter {
            NO_EMITTER => None,
            e if flags & super::EMITTER_PER_PRIMITIVE != 0 => Some(e + primitive - first_primitive),
            e => Some(e),
        };
        let emission = emitter.map_or([0.0; 3], |e| self.emitters.mean_radiance(e));
        // Instances that mirror turn the order of corners; outwards stays outwards.
        let mirrored = matrix.matrix3.determinant() < 0.0;
        let order = |swap: bool| if swap { [0, 2, 1] } else { [0, 1, 2] };
        let mut push = |behind: bool, emission: [f32; 3]| {
            let o = order(behind != mirrored);
            faces.push(Face {
                corners: o.map(|k| points[k]),
                uv: o.map(|k| uv[k]),
                instance,
                primitive,
                behind,
                shape: corners[3].0,
                material,
                emission,
            });
        };
        push(false, emission);
        if self.head(material)[0] == TWO_SIDED {
            push(true, [0.0; 3]);
        }
    }

    /// Weights of a hit's corners in the order of a face's.
    pub fn face_weights(&self, instance: u32, behind: bool, [u, v]: [f32; 2]) -> [f32; 3] {
        let w = 1.0 - u - v;
        let mirrored = self.features.instances && self.instance_matrix(instance).matrix3.determinant() < 0.0;
        if behind != mirrored { [w, v, u] } else { [w, u, v] }
    }

    fn instance_matrix(&self, instance: u32) -> DAffine3 {
        let rows = self.instances.first(instance).map(|row| row.map(f64::from));
        let column = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
        DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
    }

    /// The same of what is opaque of a material that may have holes, without anything known about it.
    pub fn albedo(&self, material: u32, uv: [f32; 2], behind: bool) -> [f32; 3] {
        let head = self.head(material);
        let material = if head[0] == MASK { head[1] } else { material };
        self.diffuse_part(material, uv, behind).reflectance
    }

    /// The numbers of a primitive: that of its shape in the order of the scene, and its own within that.
    pub fn numbers(&self, primitive: u32) -> [u32; 2] {
        let shape = f32::words(&self.primitives, Index1(primitive))[3];
        let [_, _, flags, first] = f32::words(&self.shapes, shape).map(|w| w.0);
        let round = flags & (super::IS_SPHERE | super::IS_DISK) != 0;
        [shape.0, if round { 0 } else { primitive.saturating_sub(first) }]
    }

    fn head(&self, material: u32) -> [u32; 4] {
        f32::words(&self.materials, Index1(material * MATERIAL_RECORDS)).map(|w| w.0)
    }

    /// What a material reflects diffusely at these texture coordinates, seen from one side. Coats, glass, metal and
    /// lobes count nothing, rough diffuse surfaces as smooth ones, maps of relief as flat.
    pub fn diffuse_part(&self, material: u32, uv: [f32; 2], behind: bool) -> DiffusePart {
        let head = self.head(material);
        let record = |n: u32| f32::record(&self.materials, Index1(material * MATERIAL_RECORDS + n));
        let black = DiffusePart { reflectance: [0.0; 3], whole: false };
        match head[0] {
            TWO_SIDED => self.diffuse_part(if behind { head[2] } else { head[1] }, uv, false),
            MASK => black,
            NORMAL_MAP | BUMP_MAP => DiffusePart { whole: false, ..self.diffuse_part(head[1], uv, false) },
            MIX => {
                let weight = record(1)[0];
                let [a, b] = [head[1], head[2]].map(|m| self.diffuse_part(m, uv, false));
                let mixed = |c: usize| a.reflectance[c] * (1.0 - weight) + b.reflectance[c] * weight;
                DiffusePart { reflectance: std::array::from_fn(mixed), whole: a.whole && b.whole }
            }
            model => {
                let Some(model) = Model::ALL.get(model as usize) else { return black };
                let share = match model {
                    Model::Diffuse | Model::OrenNayar | Model::Plastic | Model::AshikhminShirley => 1.0,
                    // What is neither metal nor glass.
                    Model::Principled => {
                        let [metallic, transmission, ..] = record(2);
                        let mut lobe = Lobe { color: Rgb::white(), p: [0.0; PARAMETERS] };
                        lobe.p[0] = metallic;
                        let lobe = self.varied.apply(&self.tables(), Index1(head[2]), Place::at(uv), lobe, true);
                        (1.0 - lobe.p[0]) * (1.0 - transmission)
                    }
                    // What is not glass and does not pass.
                    Model::PrincipledThin => {
                        let [transmission, _, passes, _] = record(2);
                        (1.0 - transmission) * (1.0 - passes)
                    }
                    _ => return black,
                };
                let [r, g, b, _] = record(1);
                let mut reflectance = [r, g, b].map(|x| x * share);
                if head[1] != 0 {
                    let texel = self.textures.eval(Index1(head[1] - 1), uv).lane(0);
                    (0..3).for_each(|c| reflectance[c] *= texel[c]);
                }
                DiffusePart { reflectance, whole: *model == Model::Diffuse }
            }
        }
    }

    /// Whether a material's reflectance varies over its surface.
    pub fn is_textured(&self, material: u32) -> bool {
        let head = self.head(material);
        match head[0] {
            TWO_SIDED | MIX => self.is_textured(head[1]) || self.is_textured(head[2]),
            NORMAL_MAP | BUMP_MAP | MASK => self.is_textured(head[1]),
            _ => head[1] != 0 || head[2] != 0,
        }
    }

    /// Whether a material varies by what its mesh knows of vertices and faces.
    fn has_attribute(&self, material: u32) -> bool {
        let head = self.head(material);
        match head[0] {
            TWO_SIDED | MIX => self.has_attribute(head[1]) || self.has_attribute(head[2]),
            NORMAL_MAP | BUMP_MAP | MASK => self.has_attribute(head[1]),
            _ => self.varied.has_attribute(head[2]),
        }
    }

    /// All that keeps the scene from being diffuse faces at rest, in the order of its description.
    pub fn obstacles(&self) -> Vec<Obstacle> {
        let mut found = Vec::new();
        for (shape, record) in self.shapes.iter().enumerate() {
            let [material, _, flags, _] = record.0.map(f32::to_bits);
            let name = self.names.materials.iter().find(|(m, _)| *m == material);
            let place = match name {
                Some((_, name)) => format!("{} (material \"{name}\")", self.shape_name(shape as u32)),
                None => self.shape_name(shape as u32).to_owned(),
            };
            let mut push = |what: &str, has_diffuse_part: bool| {
                found.push(Obstacle { place: place.clone(), what: what.into(), has_diffuse_part });
            };
            if flags & (super::IS_SPHERE | super::IS_DISK) != 0 {
                push(if flags & super::IS_SPHERE != 0 { "a sphere" } else { "a disk" }, false);
            }
            if self.has_attribute(material) {
                push("an attribute of vertices or faces", false);
            } else if self.head(material)[0] == MASK {
                push("a surface with holes", false);
            } else if !(self.diffuse_part(material, [0.5; 2], false).whole
                && self.diffuse_part(material, [0.5; 2], true).whole)
            {
                push(&format!("{}, which is not diffuse", self.kind(material)), true);
            }
        }
        for (instance, name) in self.names.instances.iter().enumerate() {
            if self.instances.moves(instance as u32) {
                found.push(Obstacle { place: name.clone(), what: "a motion".into(), has_diffuse_part: false });
            }
        }
        found
    }

    /// What a description calls this kind of material.
    fn kind(&self, material: u32) -> &'static str {
        let head = self.head(material);
        let whole = |m: u32| self.diffuse_part(m, [0.5; 2], false).whole;
        match head[0] {
            TWO_SIDED | MIX if whole(head[1]) => self.kind(head[2]),
            TWO_SIDED | MIX => self.kind(head[1]),
            NORMAL_MAP => "a normal map",
            BUMP_MAP => "a bump map",
            model => match Model::ALL.get(model as usize) {
                Some(Model::Mirror) => "a mirror",
                Some(Model::Dielectric | Model::RoughDielectric) => "a dielectric",
                Some(Model::ThinDielectric) => "a thin dielectric",
                Some(Model::Conductor | Model::RoughConductor | Model::CompensatedConductor) => "a conductor",
                Some(Model::Phong | Model::PhongLecture) => "a Phong lobe",
                Some(Model::BlinnPhong | Model::BlinnPhongLecture) => "a Blinn-Phong lobe",
                Some(Model::OrenNayar) => "an Oren-Nayar surface",
                Some(Model::AshikhminShirley) => "an Ashikhmin-Shirley lobe",
                Some(Model::Plastic) => "plastic",
                Some(Model::Principled) => "a principled material",
                Some(Model::PrincipledThin) => "a thin principled material",
                Some(Model::Angles | Model::HalfDifference | Model::Adaptive) => "a measured material",
                Some(Model::Diffuse) | None => "a diffuse material",
            },
        }
    }
}
