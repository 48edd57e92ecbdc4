use super::*;
use proptest::prelude::*;

/// A picture with highlights and a variance layer.
fn sample() -> Image {
    let value = |i: usize| (i as f32 * 0.37).sin().abs() * 10f32.powi(i as i32 % 9 - 4);
    let pixels: Vec<_> = (0..35).map(|i| [value(i), value(i + 7), value(i + 19)]).collect();
    let mut image = Image::from_rgb(7, 5, &pixels);
    image.layers.push(Layer::rgb("variance", &pixels));
    image
        .layers
        .push(Layer { name: "count".into(), channels: vec![Channel { name: "N".into(), data: vec![4.0; 35] }] });
    image
}

fn write(image: &Image, format: ImageFormat) -> Vec<u8> {
    write_image(image, format, &PngOptions::default()).unwrap()
}

#[test]
fn exr_keeps_everything() {
    let mut image = sample();
    image.layers[0].channels[1].data[3] = f32::INFINITY;
    let back = read_image(&write(&image, ImageFormat::Exr), "a.exr").unwrap();
    assert_eq!((back.width, back.height), (7, 5));
    assert_eq!(back.layers[0], image.layers[0]);
    assert_eq!(back.layer("variance"), image.layer("variance"));
    assert_eq!(back.layer("count"), image.layer("count"));
}

#[test]
fn pfm_keeps_the_picture() {
    let image = sample();
    let bytes = write(&image, ImageFormat::Pfm);
    assert!(bytes.starts_with(b"PF\n7 5\n-1.0\n"));
    // Bottom-up: the first stored pixel is the last row's first.
    assert_eq!(bytes[12..16], image.layers[0].channels[0].data[28].to_le_bytes());
    assert_eq!(read_image(&bytes, "a.pfm").unwrap().layers[0], image.layers[0]);
    let grey = from_interleaved(2, 2, &["Y"], &[1.0, 2.0, 3.0, 4.0]);
    assert_eq!(read_image(&write(&grey, ImageFormat::Pfm), "a.pfm").unwrap(), grey);
    let big_endian = [&b"Pf 2 1 2\n"[..], &1f32.to_be_bytes(), &3f32.to_be_bytes()].concat();
    assert_eq!(read_image(&big_endian, "a.pfm").unwrap().layers[0].channels[0].data, [2.0, 6.0]);
}

#[test]
fn hdr_rounds_to_nearest() {
    let image = sample();
    let back = read_image(&write(&image, ImageFormat::Hdr), "a.hdr").unwrap();
    for (a, b) in image.rgb("").unwrap().iter().zip(back.rgb("").unwrap()) {
        let most = a[0].max(a[1]).max(a[2]);
        for c in 0..3 {
            assert!((a[c] - b[c]).abs() <= most / 255.0, "{a:?} {b:?}");
        }
    }
    let odd =
        [[0.0; 3], [f32::NAN, 1.0, -1.0], [f32::INFINITY, 0.0, 1.0], [1e-40; 3], [f32::MAX; 3], [0.999_99, 0.5, 0.0]];
    let back = read_image(&write(&Image::from_rgb(6, 1, &odd), ImageFormat::Hdr), "a.hdr").unwrap().rgb("").unwrap();
    assert_eq!(back[0], [0.0; 3]);
    assert_eq!(back[1], [0.0, 1.0, 0.0]);
    assert!(back[2][0] > 1.6e38 && back[2][0].is_finite());
    assert_eq!(back[3], [0.0; 3]);
    assert!(back[4][0] > 1.6e38 && back[4][0].is_finite());
    assert_eq!(back[5], [1.0, 0.5, 0.0]);
}

#[test]
fn png_is_srgb() {
    let values = [0.0, 0.001, 0.02, 0.214_041_14, 0.5, 1.0, 7.0, f32::NAN];
    let pixels: Vec<_> = values.iter().map(|&v| [v; 3]).collect();
    let image = Image::from_rgb(8, 1, &pixels);
    let back = read_image_raw(&write(&image, ImageFormat::Png), "a.png").unwrap();
    let stored: Vec<u8> = back.layers[0].channels[0].data.iter().map(|v| (v * 255.0).round() as u8).collect();
    // 0.5 is 187.5 of 255 in sRGB (188), 0.02 is 0.1498, 0.214 is one half.
    assert_eq!(stored, [0, 3, 39, 128, 188, 255, 255, 0]);
    let linear = read_image(&write(&image, ImageFormat::Png), "a.png").unwrap();
    assert!((linear.layers[0].channels[0].data[4] - 0.5).abs() < 0.003);
    let brighter = write_image(&image, ImageFormat::Png, &PngOptions { exposure: 1.0, ..Default::default() }).unwrap();
    let brighter = read_image_raw(&brighter, "").unwrap();
    assert_eq!(brighter.layers[0].channels[0].data[4], 1.0);
}

#[test]
fn png_of_sixteen_bits_grey_and_alpha() {
    let png = |colour, depth, data: &[u8]| {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 1, 1);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        let channels = &read_image(&bytes, "a.png").unwrap().layers[0].channels;
        channels.iter().map(|c| (c.name.clone(), c.data[0])).collect::<Vec<_>>()
    };
    let half = png(png::ColorType::Grayscale, png::BitDepth::Sixteen, &[0x80, 0x00]);
    assert!(half.len() == 1 && half[0].0 == "Y" && (half[0].1 - srgb_decode(32768.0 / 65535.0)).abs() < 1e-6);
    let both = png(png::ColorType::GrayscaleAlpha, png::BitDepth::Eight, &[255, 51]);
    assert!(both.len() == 4 && both[..3].iter().all(|c| c.1 == 1.0) && (both[3].1 - 0.2).abs() < 1e-6);
    let colour = png(png::ColorType::Rgb, png::BitDepth::Sixteen, &[0xff, 0xff, 0, 0, 0x80, 0x00]);
    assert_eq!((colour[0].1, colour[1].1), (1.0, 0.0));
}

#[test]
fn srgb_is_its_own_inverse() {
    for i in 0..=255 {
        let encoded = i as f32 / 255.0;
        assert!((srgb_encode(srgb_decode(encoded)) - encoded).abs() < 1e-5);
    }
}

#[test]
fn tone_maps_by_their_formula() {
    assert_eq!(Tonemap::Reinhard.apply([1.0; 3]), [0.5; 3]);
    // 2.54/3.16 at 1.
    assert!((Tonemap::Aces.apply([1.0; 3])[0] - 0.803_797_5).abs() < 1e-6);
    assert!(Tonemap::Aces.apply([f32::MAX; 3])[0] > 1.0);
    assert_eq!("aces".parse(), Ok(Tonemap::Aces));
    assert!("acse".parse::<Tonemap>().is_err());
}

#[test]
fn errors_name_the_problem() {
    let error = |bytes: &[u8], name: &str| read_image(bytes, name).unwrap_err().to_string();
    assert!(error(b"hello", "a.png").starts_with("a.png: not a PNG image"));
    assert!(error(b"", "a").starts_with("a: not an image of a known format"));
    assert!(error(b"PF 3 2 -1.0\nabc", "a.pfm").contains("it ends after 3 of 72 bytes"));
    assert!(error(b"PF 0 2 -1.0\nabc", "a.pfm").contains("0×2"));
    assert!(error(b"PF 4000000000 4000000000 -1.0\nabc", "a.pfm").contains("too large"));
    assert!(error(b"PF 2 2 0\nabc", "a.pfm").contains("scale"));
    assert!(error(b"PF 2", "a.pfm").contains("no width"));
    let png = write(&sample(), ImageFormat::Png);
    assert!(error(&png[..60], "a.png").starts_with("a.png: not a valid PNG image: "));
    let nothing = write_image(&Image::default(), ImageFormat::Exr, &PngOptions::default()).unwrap_err();
    assert!(nothing.message.contains("0×0"));
    assert!(write_image(&sample(), ImageFormat::Jpeg, &PngOptions::default()).is_err());
    assert!(ImageFormat::of_name("a.gif").unwrap_err().to_string().contains("valid extensions: exr"));
    assert_eq!(ImageFormat::of_name("dir.png/a.EXR"), Ok(ImageFormat::Exr));
}

/// A small file of each format, one JPEG among them.
fn files() -> Vec<Vec<u8>> {
    let mut files: Vec<_> =
        [ImageFormat::Exr, ImageFormat::Hdr, ImageFormat::Pfm, ImageFormat::Png].map(|f| write(&sample(), f)).into();
    let mut jpeg = Vec::new();
    image::codecs::jpeg::JpegEncoder::new(&mut jpeg)
        .encode(&[100; 300], 10, 10, image::ExtendedColorType::Rgb8)
        .unwrap();
    let back = read_image(&jpeg, "a.jpg").unwrap();
    assert!((back.layers[0].channels[1].data[5] - srgb_decode(100.0 / 255.0)).abs() < 0.01);
    files.push(jpeg);
    files
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    #[test]
    fn no_broken_file_panics(which in 0..5usize, cut in 0.0..1.0f64, changes in proptest::collection::vec((0.0..1.0f64, any::<u8>()), 0..6), cuts in any::<bool>()) {
        static FILES: std::sync::OnceLock<Vec<Vec<u8>>> = std::sync::OnceLock::new();
        let mut bytes = FILES.get_or_init(files)[which].clone();
        for (at, value) in changes {
            // Mostly in the header.
            let at = (at * at * at * bytes.len() as f64) as usize;
            bytes[at] = value;
        }
        if cuts { bytes.truncate((cut * bytes.len() as f64) as usize); }
        let _ = read_image(&bytes, "a");
    }
}

#[test]
fn tga_is_known_by_its_name() {
    // Uncompressed, 2×1, 24 bits, from the top left: blue, green, red.
    let mut bytes = vec![0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 1, 0, 24, 0x20];
    bytes.extend([0, 0, 255, 255, 128, 0]);
    let image = read_image_raw(&bytes, "a.tga").expect("an image");
    assert_eq!(image.rgb("").expect("colours"), [[1.0, 0.0, 0.0], [0.0, 128.0 / 255.0, 1.0]]);
    assert!(read_image(&bytes, "a").is_err());
    assert!(write_image(&image, ImageFormat::Tga, &PngOptions::default()).is_err());
}

#[test]
fn bombs_do_not_go_off() {
    // 30000² of nothing in a few bytes: the size is refused, whatever follows.
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR".to_vec();
    png.extend(30_000u32.to_be_bytes().iter().chain(&30_000u32.to_be_bytes()).chain(&[8, 2, 0, 0, 0]));
    let mut crc = flate2::Crc::new();
    crc.update(&png[12..]);
    png.extend(crc.sum().to_be_bytes());
    png.extend(b"\0\0\0\0IDAT\x35\xaf\x06\x1e");
    let error = read_image(&png, "a.png").unwrap_err().message;
    assert!(error.contains("30000×30000 pixels is too large"), "{error}");
}
