//! The pyramid of bidirectional strategies, as one page: a row for each number of vertices, in it a picture for each (s, t)
//! (as Veach 1997, Fig. 10.2).

use crate::Failure;
use crate::lecture::png;
use crate::page::{base64, document};
use maud::{Markup, html};
use rebond::film::Image;
use rebond::math::luminance;

/// A picture of the pyramid.
struct Stone {
    s: u32,
    t: u32,
    /// Weighed, and not.
    pictures: [Vec<[f32; 3]>; 2],
    /// The weighed one's part of the row's light.
    share: f64,
}

/// Paths of one number of vertices.
struct Row {
    vertices: u32,
    stones: Vec<Stone>,
    /// Stops by which it is brightened.
    stops: f32,
    /// Its part of the picture's light.
    share: f64,
}

/// So bright is the pixel that nearly all others of a row are not brighter than, with its stops.
const BRIGHT: f32 = 0.8;
const NEARLY_ALL: f64 = 0.97;

fn light(picture: &[[f32; 3]]) -> f64 {
    picture.iter().map(|p| f64::from(luminance(*p))).sum()
}

/// The rows that an image has layers of.
fn rows(image: &Image) -> Vec<Row> {
    let whole = image.rgb("").map_or(0.0, |p| light(&p));
    let mut rows = Vec::new();
    for vertices in 2.. {
        let stones = (0..=vertices).filter_map(|s| {
            let t = vertices - s;
            let pictures = [image.rgb(&format!("s{s}-t{t}"))?, image.rgb(&format!("s{s}-t{t}-unweighted"))?];
            Some(Stone { s, t, pictures, share: 0.0 })
        });
        let mut stones: Vec<Stone> = stones.collect();
        if stones.is_empty() {
            break;
        }
        let mut sum = vec![0.0; stones[0].pictures[0].len()];
        for stone in &stones {
            sum.iter_mut().zip(&stone.pictures[0]).for_each(|(sum, p)| *sum += luminance(*p));
        }
        let of_row: f64 = sum.iter().map(|x| f64::from(*x)).sum();
        stones.iter_mut().for_each(|stone| stone.share = light(&stone.pictures[0]) / of_row.max(f64::MIN_POSITIVE));
        let bright = (sum.len() as f64 * NEARLY_ALL) as usize;
        let (_, bright, _) =
            sum.select_nth_unstable_by(bright.min(image.width as usize * image.height as usize - 1), f32::total_cmp);
        let stops = if *bright > 0.0 { (BRIGHT / *bright).log2().round() } else { 0.0 };
        rows.push(Row { vertices, stones, stops, share: of_row / whole.max(f64::MIN_POSITIVE) });
    }
    rows
}

const STYLE: &str = include_str!("pyramid.css");

/// The page of an image with the layers of all strategies; `made` says how it was made.
pub fn page(image: &Image, scene: &str, made: &str) -> Result<String, Failure> {
    let rows = rows(image);
    let mut drawn = Vec::new();
    for row in &rows {
        let stones: Result<Vec<Markup>, Failure> = row.stones.iter().map(|stone| figure(image, row, stone)).collect();
        drawn.push((row, stones?));
    }
    let whole = image.rgb("").map(|p| Image::from_rgb(image.width, image.height, &p)).unwrap_or_default();
    let most = rows.last().map_or(2, |r| r.stones.len());
    let title = format!("{scene}: the strategies of bidirectional path tracing");
    let body = html! {
        input type="radio" name="which" id="weighted" checked;
        input type="radio" name="which" id="unweighted";
        header {
            h1 { (scene) ", way by way" }
            p {
                "A path of s + t vertices, s of them found from a light and t from the eye, can be found in s + t + 1 ways. Each \
                 row has the paths of one number of vertices; weighted, all pictures of the page add up to the whole. \
                 Unweighted, every picture of a row would be the same, but for noise and for what its way cannot find."
            }
            p class="choice" {
                label for="weighted" { "weighted" } label for="unweighted" { "unweighted" }
            }
        }
        main style={ "--most:" (most) } {
            figure class="whole" { (picture(&whole, 0.0, &format!("{scene}, all paths"), "")?) figcaption { "the whole" } }
            @for (row, stones) in &drawn {
                section {
                    h2 {
                        (row.vertices) " vertices" small {
                            (format!("{:.2} % of all light", 100.0 * row.share))
                            @if row.stops != 0.0 { (format!(", {:+.0} stops", row.stops)) }
                        }
                    }
                    div class="ways" { @for stone in stones { (stone) } }
                }
            }
        }
        footer { p { (made) } }
    };
    Ok(document("en", &title, STYLE, &body))
}

fn figure(image: &Image, row: &Row, stone: &Stone) -> Result<Markup, Failure> {
    let Stone { s, t, pictures, share } = stone;
    let [weighed, full] = pictures.each_ref().map(|p| Image::from_rgb(image.width, image.height, p));
    let what = format!("s = {s}, t = {t}");
    let nothing = light(&pictures[1]) == 0.0;
    Ok(html! {
        figure {
            @if nothing {
                div class="none" style={ "aspect-ratio:" (image.width) "/" (image.height) } { "nothing" }
            } @else {
                (picture(&weighed, row.stops, &format!("{what}, weighted: {:.1} % of the row's light", 100.0 * share), "w")?)
                (picture(&full, row.stops, &format!("{what}, unweighted"), "u")?)
            }
            figcaption { (what) @if !nothing { span class="w" { (format!(" · {:.1} %", 100.0 * share)) } } }
        }
    })
}

fn picture(image: &Image, stops: f32, alt: &str, class: &str) -> Result<Markup, Failure> {
    let data = base64(&png(image, stops)?);
    let (width, height) = (image.width, image.height);
    Ok(html! { img class=(class) src={ "data:image/png;base64," (data) } alt=(alt) width=(width) height=(height); })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rebond::film::Layer;

    /// The page has each way once, says its share, and needs nothing else.
    #[test]
    fn a_page_of_six_ways() {
        let picture = |x: f32| vec![[x; 3]; 6];
        let mut image = Image::from_rgb(3, 2, &picture(4.0));
        for (s, t, weighed) in
            [(0, 2, 3.0), (1, 1, 1.0), (2, 0, 0.0), (0, 3, 0.5), (1, 2, 0.0), (2, 1, 0.5), (3, 0, 0.0)]
        {
            image.layers.push(Layer::rgb(&format!("s{s}-t{t}"), &picture(weighed)));
            image.layers.push(Layer::rgb(&format!("s{s}-t{t}-unweighted"), &picture(if s == 3 { 0.0 } else { 4.0 })));
        }
        let page = page(&image, "box", "by hand").ok().expect("a page");
        for words in
            ["s = 0, t = 2, weighted: 75.0 %", "s = 1, t = 1, weighted: 25.0 %", "s = 2, t = 1, weighted: 50.0 %"]
        {
            assert_eq!(page.matches(words).count(), 1, "{words}");
        }
        // The whole, six ways weighted and not; (3, 0) finds nothing.
        assert_eq!(page.matches("<img").count(), 13);
        assert_eq!(page.matches("alt=\"").count(), 13);
        assert_eq!(page.matches("nothing</div>").count(), 1);
        assert!(!page.contains("http"), "nothing from elsewhere");
        // A row as bright as 1 gets no stops (log2 0.8 rounds to 0); the first, of 4, gets two less.
        assert!(page.contains("100.00 % of all light, -2 stops") && page.contains("25.00 % of all light<"));
    }
}
