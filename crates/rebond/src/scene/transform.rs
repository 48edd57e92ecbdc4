//! From the steps of a description to matrices, and to motion.

use super::BuildError;
use super::description::{Keyframe, Transform, TransformStep};
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};

/// Where a thing is: at one time (always), or at several, linearly interpolated in between.
#[derive(Clone, Debug)]
pub struct Motion(pub Vec<(f32, DAffine3)>);

/// Interpolated rotations are cut into linear pieces of at most this angle, so that a point strays from its arc by at
/// most 1 − cos 1° = 1.5·10⁻⁴ of its distance from the axis.
const LARGEST_TURN: f64 = 2.0 * std::f64::consts::PI / 180.0;

fn vector(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

impl Motion {
    /// A thing at rest.
    pub fn rest(matrix: DAffine3) -> Self {
        Self(vec![(0.0, matrix)])
    }

    /// The only place, if it does not move.
    pub fn at_rest(&self) -> Option<&DAffine3> {
        if let [(_, m)] = &self.0[..] { Some(m) } else { None }
    }
}

impl Transform {
    /// Multiplies the steps out. `path` is the place of this transform in the description, for errors.
    pub fn motion(&self, path: &str) -> Result<Motion, BuildError> {
        let mut motion = Motion::rest(DAffine3::IDENTITY);
        for (i, step) in self.0.iter().enumerate() {
            let path = if self.0.len() == 1 { path.to_string() } else { format!("{path}[{i}]") };
            let step = step.motion(&path)?;
            motion = match (motion.at_rest(), step.at_rest()) {
                (_, Some(s)) => Motion(motion.0.iter().map(|(t, m)| (*t, *s * *m)).collect()),
                (Some(m), None) => Motion(step.0.iter().map(|(t, s)| (*t, *s * *m)).collect()),
                (None, None) => return Err(BuildError::new(&path, "a second list of keyframes in one transform")),
            };
        }
        Ok(motion)
    }

    /// The matrix of a transform that may not move.
    pub fn matrix(&self, path: &str, what: &str) -> Result<DAffine3, BuildError> {
        let moving = || BuildError::new(path, format!("{what} cannot move")).help("leave out the keyframes");
        self.motion(path)?.at_rest().copied().ok_or_else(moving)
    }
}

impl TransformStep {
    fn motion(&self, path: &str) -> Result<Motion, BuildError> {
        let one_at_most = "give each step exactly one of translate, scale, rotate, look_at, matrix, keyframes";
        let mut given = Vec::new();
        if let Some(t) = self.translate {
            given.push(DAffine3::from_translation(vector(t)));
        }
        if let Some(s) = self.scale {
            if s.0.contains(&0.0) {
                return Err(BuildError::new(format!("{path}.scale"), "scaling by 0 leaves nothing to see"));
            }
            given.push(DAffine3::from_scale(vector(s.0)));
        }
        if let Some(r) = self.rotate {
            let axis = vector(r.axis).try_normalize();
            let axis =
                axis.ok_or_else(|| BuildError::new(format!("{path}.rotate.axis"), "the axis of a rotation is zero"))?;
            given.push(DAffine3::from_axis_angle(axis, f64::from(r.angle).to_radians()));
        }
        if let Some(l) = self.look_at {
            let (origin, place) = (vector(l.origin), format!("{path}.look_at"));
            let z = (vector(l.target) - origin).try_normalize();
            let z = z.ok_or_else(|| {
                BuildError::new(format!("{place}.target"), "`target` and `origin` are the same point")
            })?;
            let x = vector(l.up).cross(z).try_normalize();
            let parallel = || BuildError::new(format!("{place}.up"), "`up` is zero or along the direction of view");
            let x = x.ok_or_else(parallel)?;
            given.push(DAffine3::from_mat3_translation(DMat3::from_cols(x, z.cross(x), z), origin));
        }
        if let Some(rows) = &self.matrix {
            given.push(matrix_of_rows(rows, &format!("{path}.matrix"))?);
        }
        if let Some(keyframes) = &self.keyframes {
            let path = format!("{path}.keyframes");
            return if given.is_empty() {
                keyframed(keyframes, &path)
            } else {
                Err(BuildError::new(path, one_at_most))
            };
        }
        match given[..] {
            [m] => Ok(Motion::rest(m)),
            [] => Err(BuildError::new(path, "an empty step in a transform").help(one_at_most)),
            _ => Err(BuildError::new(path, "several operations in one step of a transform").help(one_at_most)),
        }
    }
}

fn matrix_of_rows(rows: &[[f32; 4]], path: &str) -> Result<DAffine3, BuildError> {
    let bad = |message: &str| Err(BuildError::new(path, message));
    if rows.len() == 4 && rows[3] != [0.0, 0.0, 0.0, 1.0] {
        return bad("the last row of an affine matrix is [0, 0, 0, 1]");
    }
    if !(rows.len() == 3 || rows.len() == 4) {
        return bad("a matrix has three or four rows");
    }
    let row = |i: usize| rows[i].map(f64::from);
    let last = [0.0, 0.0, 0.0, 1.0];
    let m = DAffine3::from_mat4(DMat4::from_cols_array_2d(&[row(0), row(1), row(2), last]).transpose());
    if m.matrix3.determinant().abs() < 1e-30 {
        return bad("the matrix is singular: it flattens everything");
    }
    Ok(m)
}

fn keyframed(keyframes: &[Keyframe], path: &str) -> Result<Motion, BuildError> {
    if keyframes.len() < 2 {
        return Err(BuildError::new(path, "a motion needs two keyframes or more"));
    }
    let mut motion: Vec<(f32, DAffine3)> = Vec::new();
    for (i, k) in keyframes.iter().enumerate() {
        let place = format!("{path}[{i}]");
        let m = k.to_world.matrix(&format!("{place}.to_world"), "a keyframe")?;
        if let Some((time, before)) = motion.last().copied() {
            if k.time <= time {
                return Err(BuildError::new(format!("{place}.time"), "the times of keyframes must increase"));
            }
            let (s0, r0, t0) = before.to_scale_rotation_translation();
            let (s1, r1, t1) = m.to_scale_rotation_translation();
            // A shear has no place in scale, rotation and translation: then the matrices themselves are interpolated.
            let whole = |s, r, t, m: DAffine3| {
                DAffine3::from_scale_rotation_translation(s, r, t)
                    .abs_diff_eq(m, 1e-6 * m.matrix3.x_axis.length().max(1e-6))
            };
            let rigid = whole(s0, r0, t0, before) && whole(s1, r1, t1, m);
            let pieces = if rigid { (turn(r0, r1) / LARGEST_TURN).ceil().max(1.0) as u32 } else { 1 };
            for piece in 1..pieces {
                let x = f64::from(piece) / f64::from(pieces);
                let between =
                    DAffine3::from_scale_rotation_translation(s0.lerp(s1, x), r0.slerp(r1, x), t0.lerp(t1, x));
                motion.push((time + (k.time - time) * x as f32, between));
            }
        }
        motion.push((k.time, m));
    }
    Ok(Motion(motion))
}

/// The angle between two orientations.
fn turn(a: DQuat, b: DQuat) -> f64 {
    2.0 * a.dot(b).abs().min(1.0).acos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::description::{Color, LookAt, Rotate};

    fn step(f: impl FnOnce(&mut TransformStep)) -> TransformStep {
        let mut s = TransformStep::default();
        f(&mut s);
        s
    }

    #[test]
    fn steps_apply_in_order() {
        let t = Transform(vec![
            step(|s| s.scale = Some(Color([2.0; 3]))),
            step(|s| s.rotate = Some(Rotate { axis: [0.0, 0.0, 1.0], angle: 90.0 })),
            step(|s| s.translate = Some([1.0, 0.0, 0.0])),
        ]);
        let p = t.matrix("", "it").expect("a matrix").transform_point3(DVec3::X);
        assert!((p - DVec3::new(1.0, 2.0, 0.0)).length() < 1e-12);
    }

    #[test]
    fn looking_at_a_point_puts_it_on_z() {
        let look = LookAt { origin: [1.0, 2.0, 3.0], target: [4.0, 2.0, 7.0], up: [0.0, 1.0, 0.0] };
        let m = Transform(vec![step(|s| s.look_at = Some(look))]).matrix("", "it").expect("a matrix");
        assert!((m.transform_point3(DVec3::Z * 5.0) - DVec3::new(4.0, 2.0, 7.0)).length() < 1e-12);
        assert!((m.matrix3.determinant() - 1.0).abs() < 1e-12 && m.transform_vector3(DVec3::Y).y > 0.999);
    }

    #[test]
    fn a_turning_point_stays_near_its_arc() {
        let key = |time, angle| Keyframe {
            time,
            to_world: Transform(vec![step(|s| s.rotate = Some(Rotate { axis: [0.0, 1.0, 0.0], angle }))]),
        };
        let t = Transform(vec![step(|s| s.keyframes = Some(vec![key(0.0, 0.0), key(1.0, 90.0)]))]);
        let motion = t.motion("").expect("a motion");
        assert!(motion.0.len() >= 46, "pieces of two degrees");
        for pair in motion.0.windows(2) {
            let halfway = (pair[0].1.transform_point3(DVec3::X) + pair[1].1.transform_point3(DVec3::X)) / 2.0;
            assert!((halfway.length() - 1.0).abs() < 1.6e-4);
        }
    }

    #[test]
    fn what_is_wrong_is_said_with_its_place() {
        let path = |t: &Transform| t.motion("t").expect_err("an error").path;
        let both = step(|s| (s.translate, s.scale) = (Some([0.0; 3]), Some(Color([1.0; 3]))));
        assert_eq!(path(&Transform(vec![both.clone()])), "t");
        assert_eq!(path(&Transform(vec![step(|s| s.translate = Some([0.0; 3])), both])), "t[1]");
        assert_eq!(path(&Transform(vec![step(|s| s.scale = Some(Color([1.0, 0.0, 1.0])))])), "t.scale");
        assert_eq!(path(&Transform(vec![step(|s| s.matrix = Some(vec![[0.0; 4]; 3]))])), "t.matrix");
    }
}
