//! The wide number does what sixteen narrow ones do, bit for bit, and the elementary functions are as accurate as they say.

use proptest::prelude::*;
use rebond_lanes::{F32x16, Index, Mask, Mask16, Real, Record, math};

fn wide(x: [f32; 16]) -> F32x16 {
    F32x16::load(&x)
}

/// Compares a function of two numbers at both widths.
fn same(a: [f32; 16], b: [f32; 16], narrow: impl Fn(f32, f32) -> f32, lanes: impl Fn(F32x16, F32x16) -> F32x16) {
    let w = lanes(wide(a), wide(b));
    for i in 0..16 {
        let n = narrow(a[i], b[i]);
        assert!(
            n.to_bits() == w.lane(i).to_bits() || n.is_nan() && w.lane(i).is_nan(),
            "lane {i}: f({:e}, {:e}) is {n:e} for one lane, {:e} for sixteen",
            a[i],
            b[i],
            w.lane(i)
        );
    }
}

macro_rules! check {
    ($a:expr, $b:expr, |$x:ident, $y:ident| $body:expr) => {{
        fn narrow<F: Real>($x: F, $y: F) -> F {
            $body
        }
        same($a, $b, narrow::<f32>, narrow::<F32x16>);
    }};
}

fn numbers() -> impl Strategy<Value = [f32; 16]> {
    let any =
        prop_oneof![8 => -100.0f32..100.0, 2 => any::<f32>(), 1 => Just(0.0f32), 1 => Just(-0.0f32), 1 => Just(1.0f32)];
    prop::array::uniform16(any)
}

proptest! {
    #[test]
    fn widths_agree(a in numbers(), b in numbers()) {
        check!(a, b, |x, y| x + y);
        check!(a, b, |x, y| x - y * 3.0);
        check!(a, b, |x, y| x * y);
        check!(a, b, |x, y| x / y);
        check!(a, b, |x, y| x.mul_add(y, x));
        check!(a, b, |x, y| x.min(y));
        check!(a, b, |x, y| x.max(y));
        check!(a, b, |x, y| F::select(x.lt(y) | x.eq(y), x.abs().sqrt(), y.floor()));
        check!(a, b, |x, y| F::select(x.le(y).and_not(x.gt(y)), -x, y.recip()));
        check!(a, b, |x, y| F::from_index(x.clamp(0.0, 1e9).to_index() + y.clamp(0.0, 1e9).to_index()));
        check!(a, b, |x, y| F::from_bits((x.to_bits() ^ y.to_bits()) >> 9));
        check!(a, b, |x, y| F::from_index((x.to_bits() * y.to_bits()).reverse_bits() >> 1));
        check!(a, b, |x, y| x.copy_sign(y));
    }

    #[test]
    fn elementary_functions_agree(a in numbers(), b in numbers()) {
        check!(a, b, |x, y| math::sin_cos(x.clamp(-8e3, 8e3)).0 + y);
        check!(a, b, |x, y| math::sin_cos(x.clamp(-8e3, 8e3)).1 + y);
        check!(a, b, |x, y| math::exp2(x) + y);
        check!(a, b, |x, y| math::log2(x.abs()) + y);
        check!(a, b, |x, y| math::pow(x.abs(), y));
        check!(a, b, |x, y| math::acos(x) + y);
        check!(a, b, |x, y| math::atan2(x, y));
    }

    #[test]
    fn masks_and_records(bits in 0u32..0x1_0000, at in prop::array::uniform16(0u32..60), x in numbers()) {
        let mask = Mask16::from_bits(bits);
        prop_assert_eq!(mask.bits(), bits);
        prop_assert_eq!((!mask).bits(), !bits & 0xffff);
        prop_assert_eq!(mask.count(), bits.count_ones());
        prop_assert_eq!((mask.any(), mask.all(), mask.none()), (bits != 0, bits == 0xffff, bits == 0));

        let mut packed = [f32::NAN; 16];
        let n = wide(x).compress(mask, &mut packed);
        let expected: Vec<u32> = (0..16).filter(|i| bits >> i & 1 == 1).map(|i| x[i].to_bits()).collect();
        prop_assert_eq!(packed[..n].iter().map(|v| v.to_bits()).collect::<Vec<_>>(), expected);

        // Fifty records; an index beyond the last reads the last.
        let table: Vec<Record> = (0..50).map(|i| Record([0.0, 1.0, 2.0, 3.0].map(|w| (10 * i) as f32 + w))).collect();
        let mut index = <F32x16 as Real>::Index::splat(0);
        for (lane, i) in at.iter().enumerate() {
            index = index.with_lane(lane, *i);
        }
        let wide = F32x16::record(&table, index);
        for (lane, i) in at.iter().enumerate() {
            let narrow = f32::record(&table, Index::splat(*i));
            prop_assert_eq!(narrow, table[(*i).min(49) as usize].0);
            prop_assert_eq!([0, 1, 2, 3].map(|w| wide[w].lane(lane)), narrow);
        }
    }
}

/// The largest error of `f` against `exact` over a dense sweep.
fn worst(range: (f64, f64), f: impl Fn(f32) -> f32, exact: impl Fn(f64) -> f64, relative: bool) -> f64 {
    let n = 2_000_000;
    (0..=n)
        .map(|i| {
            let x = (range.0 + (range.1 - range.0) * f64::from(i) / f64::from(n)) as f32;
            let (got, want) = (f64::from(f(x)), exact(f64::from(x)));
            (got - want).abs() / if relative { want.abs() } else { 1.0 }
        })
        .fold(0.0, f64::max)
}

#[test]
fn accuracy_is_as_documented() {
    let errors = [
        ("sin", worst((-100.0, 100.0), |x| math::sin_cos(x).0, f64::sin, false), 1.5e-7),
        ("cos", worst((-100.0, 100.0), |x| math::sin_cos(x).1, f64::cos, false), 1.5e-7),
        ("sin, far", worst((-8192.0, 8192.0), |x| math::sin_cos(x).0, f64::sin, false), 1.5e-7),
        ("exp2", worst((-125.9, 127.9), math::exp2, f64::exp2, true), 3e-7),
        ("log2", worst((1.1, 1e6), math::log2, f64::log2, true), 3e-7),
        ("log2, below one", worst((1e-6, 1.0), math::log2, f64::log2, false), 1.5e-6),
        ("acos", worst((-1.0, 1.0), math::acos, f64::acos, false), 1e-6),
        ("atan2", worst((-50.0, 50.0), |x| math::atan2(x, 3.0), |x| x.atan2(3.0), false), 1e-6),
    ];
    for (name, error, bound) in errors {
        assert!(error < bound, "{name}: error {error:e}, documented {bound:e}");
    }
}

#[test]
fn special_values() {
    assert_eq!(math::pow(0.0f32, 60.0), 0.0);
    assert_eq!(math::pow(0.0f32, 0.0), 1.0);
    assert_eq!(math::pow(1.0f32, 300.0), 1.0);
    assert_eq!(math::exp2(-200.0f32), 0.0);
    assert_eq!(math::exp2(3.0f32), 8.0);
    assert_eq!(math::exp2(200.0f32), f32::INFINITY);
    assert_eq!(math::ln(0.0f32), f32::NEG_INFINITY);
    assert_eq!(math::log2(1.0f32), 0.0);
    assert_eq!(math::atan2(0.0f32, 0.0), 0.0);
    assert_eq!(math::acos(1.0f32), 0.0);
}
