//! Draws the pixels of a plot, with a font of our own, and writes them as PNG: the same bytes on
//! every host.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    reason = "a drawing has some hundreds of units"
)]

use std::io::Write;

use flate2::write::ZlibEncoder;
use flate2::{Compression, Crc};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord as Place, BackendStyle, BackendTextStyle, FontStyle,
};
use tiny_skia::{Color, FillRule, Paint, Path, PathBuilder, Pixmap, Stroke, Transform};
use ttf_parser::{Face, GlyphId, OutlineBuilder};

/// Pixels for one unit of the drawing.
const SCALE: u16 = 2;
/// `fonts/LICENSE` is the licence of both fonts.
const REGULAR: &[u8] = include_bytes!("../../fonts/inter-regular.ttf");
const SEMIBOLD: &[u8] = include_bytes!("../../fonts/inter-semibold.ttf");

/// The pixels of a drawing.
pub(super) struct Picture(Pixmap);

impl Picture {
    /// Begins a picture of a drawing of this width and height.
    pub(super) fn new((width, height): (u32, u32)) -> Self {
        let pixels = |units: u32| units * u32::from(SCALE);
        Self(Pixmap::new(pixels(width), pixels(height)).expect("a drawing is not empty"))
    }

    /// Draws a line from place to place.
    pub(super) fn line(&mut self, places: &[Place], style: &impl BackendStyle) {
        self.stroke(polygon(places, false), style);
    }

    /// Fills the shape between some places.
    pub(super) fn fill(&mut self, places: &[Place], style: &impl BackendStyle) {
        self.paint(polygon(places, true), style.color());
    }

    /// Draws a rectangle from its upper left to its lower right corner.
    pub(super) fn rectangle(
        &mut self,
        (left, top): Place,
        (right, bottom): Place,
        style: &impl BackendStyle,
        fill: bool,
    ) {
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
        if fill {
            self.fill(&corners, style);
        } else {
            self.stroke(polygon(&corners, true), &style.color());
        }
    }

    /// Draws a circle.
    pub(super) fn circle(&mut self, at: Place, radius: u32, style: &impl BackendStyle, fill: bool) {
        let (x, y) = exact(at);
        let path = PathBuilder::from_circle(x, y, radius as f32);
        if fill { self.paint(path, style.color()) } else { self.stroke(path, style) }
    }

    /// Draws a text at the place where an SVG viewer would draw it.
    pub(super) fn text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: Place) {
        let face = match style.style() {
            FontStyle::Bold => SEMIBOLD,
            FontStyle::Normal | FontStyle::Oblique | FontStyle::Italic => REGULAR,
        };
        let face = Face::parse(face, 0).expect("the fonts are ours");
        let glyphs: Vec<(GlyphId, f32)> = text
            .chars()
            .map(|letter| {
                let glyph = face.glyph_index(letter).unwrap_or_default();
                (glyph, f32::from(face.glyph_hor_advance(glyph).unwrap_or_default()))
            })
            .collect();
        let width: f32 = glyphs.iter().map(|(_, advance)| advance).sum();
        let mut outline = Outline { x: 0.0, path: PathBuilder::new() };
        outline.x = match style.anchor().h_pos {
            HPos::Left => 0.0,
            HPos::Center => -width / 2.0,
            HPos::Right => -width,
        };
        for (glyph, advance) in glyphs {
            face.outline_glyph(glyph, &mut outline);
            outline.x += advance;
        }
        // The SVG shifts the text by 0.76em or by 0.5ex, and an ex is half an em.
        let below = match style.anchor().v_pos {
            VPos::Top => 0.76,
            VPos::Center => 0.25,
            VPos::Bottom => -0.25,
        };
        // The SVG backend of plotters also divides the size by 1.24.
        let size = (style.size() / 1.24) as f32;
        let em = size / f32::from(face.units_per_em());
        let (right, down) = style.transform().transform(1, 0);
        let (x, y) = exact(at);
        let placed = Transform::from_scale(em, -em).post_translate(0.0, below * size).post_concat(
            Transform::from_row(right as f32, down as f32, -down as f32, right as f32, x, y),
        );
        let path = outline.path.finish().and_then(|path| path.transform(placed));
        self.paint(path, style.color());
    }

    fn stroke(&mut self, path: Option<Path>, style: &impl BackendStyle) {
        let Some(path) = path else { return };
        let stroke = Stroke { width: style.stroke_width() as f32, ..Stroke::default() };
        self.0.stroke_path(&path, &paint(style.color()), &stroke, scaled(), None);
    }

    fn paint(&mut self, path: Option<Path>, colour: BackendColor) {
        let Some(path) = path else { return };
        self.0.fill_path(&path, &paint(colour), FillRule::Winding, scaled(), None);
    }

    /// Writes the picture as PNG, with 8 bits each of red, green and blue. It needs no
    /// transparency, because its ground hides everything behind it.
    pub(super) fn png(&self) -> Vec<u8> {
        let (width, height) = (self.0.width(), self.0.height());
        let row = width as usize * 4;
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
        let mut filtered = Vec::new();
        let mut above = vec![0; row];
        for pixels in self.0.data().chunks_exact(row) {
            // PNG's filter 2: each byte is its difference from the byte above it.
            filtered.clear();
            filtered.push(2);
            let differences = pixels.iter().zip(&above).map(|(it, above)| it.wrapping_sub(*above));
            filtered
                .extend(differences.enumerate().filter(|(at, _)| at % 4 != 3).map(|(_, it)| it));
            packed.write_all(&filtered).expect(IN_MEMORY);
            above.copy_from_slice(pixels);
        }
        let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
        let size = [width.to_be_bytes(), height.to_be_bytes()].concat();
        chunk(&mut png, *b"IHDR", &[&size[..], &[8, 2, 0, 0, 0]].concat());
        chunk(&mut png, *b"IDAT", &packed.finish().expect(IN_MEMORY));
        chunk(&mut png, *b"IEND", &[]);
        png
    }
}

const IN_MEMORY: &str = "it is in memory";

/// The outline of a text in units of its font. Its y axis points upwards.
struct Outline {
    /// The position of the glyph.
    x: f32,
    path: PathBuilder,
}

impl OutlineBuilder for Outline {
    fn move_to(&mut self, x: f32, y: f32) {
        self.path.move_to(self.x + x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.path.line_to(self.x + x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.path.quad_to(self.x + x1, y1, self.x + x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.path.cubic_to(self.x + x1, y1, self.x + x2, y2, self.x + x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}

fn chunk(png: &mut Vec<u8>, kind: [u8; 4], data: &[u8]) {
    let length = u32::try_from(data.len()).expect("a picture has some kilobytes");
    let mut sum = Crc::new();
    sum.update(&kind);
    sum.update(data);
    png.extend(length.to_be_bytes());
    png.extend(kind);
    png.extend(data);
    png.extend(sum.sum().to_be_bytes());
}

fn exact((x, y): Place) -> (f32, f32) {
    (x as f32, y as f32)
}

fn scaled() -> Transform {
    Transform::from_scale(SCALE.into(), SCALE.into())
}

fn paint(BackendColor { alpha, rgb: (red, green, blue) }: BackendColor) -> Paint<'static> {
    let mut colour = Color::from_rgba8(red, green, blue, u8::MAX);
    colour.set_alpha(alpha as f32);
    let mut paint = Paint::default();
    paint.set_color(colour);
    paint
}

fn polygon(places: &[Place], is_closed: bool) -> Option<Path> {
    let mut path = PathBuilder::new();
    let mut places = places.iter().copied().map(exact);
    let (x, y) = places.next()?;
    path.move_to(x, y);
    places.for_each(|(x, y)| path.line_to(x, y));
    if is_closed {
        path.close();
    }
    path.finish()
}
