//! Draws plots: a sheet with a title and keys, and charts on it.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::combinators::WithKeyPoints;
use plotters::coord::ranged1d::{AsRangedCoord, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::plot::picture::Picture;
use crate::plot::sheet::Sheet;
use crate::plot::{Drawing, Theme, pieces};

/// A sheet to draw on.
pub type Canvas<'a> = DrawingArea<Sheet<'a>, Shift>;
/// A chart; its axes are linear unless given.
pub type Chart<'a, 'b, X = RangedCoordf64, Y = RangedCoordf64> =
    ChartContext<'a, Sheet<'b>, Cartesian2d<X, Y>>;

/// Drawing into a string does not fail.
pub const DRAWN: &str = "a drawing in memory";

/// States how a line of text is set.
#[derive(Clone, Copy)]
pub struct TextLine {
    size: f64,
    colour: RGBColor,
    is_bold: bool,
    pos: Pos,
}

impl TextLine {
    /// Sets text of this size and colour, at the left and in the middle of its line.
    #[must_use]
    pub const fn new(size: f64, colour: RGBColor) -> Self {
        let pos = Pos { h_pos: HPos::Left, v_pos: VPos::Center };
        Self { size, colour, is_bold: false, pos }
    }

    /// Sets it in bold.
    #[must_use]
    pub const fn bold(self) -> Self {
        Self { is_bold: true, ..self }
    }

    /// Centres it.
    #[must_use]
    pub const fn centred(self) -> Self {
        Self { pos: Pos { h_pos: HPos::Center, v_pos: VPos::Center }, ..self }
    }

    /// Sets it at the right.
    #[must_use]
    pub const fn right(self) -> Self {
        Self { pos: Pos { h_pos: HPos::Right, v_pos: VPos::Center }, ..self }
    }

    /// Returns the style for the crate `plotters`.
    #[must_use]
    pub fn style(&self) -> TextStyle<'static> {
        let style = if self.is_bold { FontStyle::Bold } else { FontStyle::Normal };
        let font = FontDesc::new(FontFamily::Name(FAMILY), self.size, style);
        font.color(&self.colour).pos(self.pos)
    }

    /// Puts a text at a place.
    ///
    /// # Panics
    /// Never: drawing into a string does not fail.
    pub fn put(&self, canvas: &Canvas<'_>, text: &str, at: (i32, i32)) {
        canvas.draw_text(text, &self.style(), at).expect(DRAWN);
    }
}

/// The font of our pictures, then the fonts of a viewer of the SVG.
const FAMILY: &str = "Inter, system-ui, sans-serif";

/// Draws on a sheet of this size with a title and a line below it.
///
/// # Panics
/// Never: drawing into a string does not fail.
#[must_use]
pub fn canvas(
    theme: &Theme,
    (width, height): (u32, u32),
    (title, below): (&str, &str),
    draw: impl FnOnce(&Canvas<'_>),
) -> Drawing {
    let (mut svg, mut picture) = (String::new(), Picture::new((width, height)));
    {
        let sheet = Sheet::new(&mut svg, &mut picture, (width, height));
        let root = sheet.into_drawing_area();
        root.fill(&theme.ground).expect(DRAWN);
        TextLine::new(19.0, theme.ink).bold().put(&root, title, (24, 30));
        TextLine::new(13.0, theme.soft).put(&root, below, (24, 54));
        draw(&root);
        root.present().expect(DRAWN);
    }
    Drawing { svg, png: picture.png() }
}

/// The parts of an axis.
pub trait Scale: AsRangedCoord<Value = f64> {}

impl<T: AsRangedCoord<Value = f64>> Scale for T {}

/// Returns a logarithmic scale with a line at each power of ten, between powers of ten.
#[must_use]
pub fn logarithmic(range: &Range<f64>) -> LogPoints {
    let mut powers = vec![range.start];
    while let Some(last) = powers.last().filter(|last| **last * 5.0 < range.end) {
        powers.push(last * 10.0);
    }
    LogCoord::from((range.start..range.end).log_scale()).with_key_points(powers)
}

/// A logarithmic axis.
pub type LogPoints = WithKeyPoints<LogCoord<f64>>;

/// The ranges and names of two axes.
pub struct Axes {
    /// From left to right.
    pub x: Range<f64>,
    /// From bottom to top.
    pub y: Range<f64>,
    /// The name below the horizontal axis.
    pub x_name: &'static str,
    /// The name beside the vertical axis.
    pub y_name: &'static str,
}

/// A line of a chart, and its key.
pub struct ChartLine {
    /// The word of its key.
    pub name: String,
    /// The colour on the current ground.
    pub colour: RGBColor,
    /// The width in units of the drawing.
    pub width: u32,
    /// `true` if it has gaps.
    pub is_dashed: bool,
    /// The points that the line connects.
    pub points: Vec<(f64, f64)>,
}

impl Axes {
    /// Returns a chart with a grid and its axes named.
    #[must_use]
    pub fn chart<'a, 'b>(&self, theme: &Theme, canvas: &'a Canvas<'b>) -> Chart<'a, 'b> {
        self.scaled(theme, canvas, (self.x.clone(), self.y.clone()))
    }

    /// Draws a chart with the caller's scales, which have the ranges.
    ///
    /// # Panics
    /// Never: drawing into a string does not fail.
    pub fn scaled<'a, 'b, X: Scale, Y: Scale>(
        &self,
        theme: &Theme,
        canvas: &'a Canvas<'b>,
        (x, y): (X, Y),
    ) -> Chart<'a, 'b, X::CoordDescType, Y::CoordDescType>
    where
        X::CoordDescType: ValueFormatter<f64>,
        Y::CoordDescType: ValueFormatter<f64>,
    {
        let mut chart = ChartBuilder::on(canvas)
            .x_label_area_size(46)
            .y_label_area_size(58)
            .build_cartesian_2d(x, y)
            .expect(DRAWN);
        let soft = TextLine::new(13.0, theme.soft);
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(theme.line)
            .axis_style(theme.soft)
            .x_labels(11)
            .y_labels(8)
            .x_label_formatter(&|value| plain(*value))
            .y_label_formatter(&|value| plain(*value))
            .label_style(TextLine { pos: Pos::default(), ..soft }.style())
            .axis_desc_style(TextLine { pos: Pos::default(), colour: theme.ink, ..soft }.style())
            .x_desc(self.x_name)
            .y_desc(self.y_name)
            .draw()
            .expect(DRAWN);
        chart
    }
}

impl ChartLine {
    /// Draws the line on a chart with these axes. Parts that lie outside are cut off at the edge.
    ///
    /// # Panics
    /// Never: drawing into a string does not fail.
    pub fn draw<X, Y>(&self, chart: &mut Chart<'_, '_, X, Y>, axes: &Axes)
    where
        X: Ranged<ValueType = f64>,
        Y: Ranged<ValueType = f64>,
    {
        let style = self.colour.stroke_width(self.width);
        for piece in pieces(&self.points, [&axes.x, &axes.y]) {
            if self.is_dashed {
                chart.draw_series(DashedLineSeries::new(piece, 6, 4, style)).expect(DRAWN);
            } else {
                chart.draw_series(LineSeries::new(piece, style)).expect(DRAWN);
            }
        }
    }

    /// Draws the keys of lines in a row that begins at a place.
    ///
    /// # Panics
    /// Never: drawing into a string does not fail.
    pub fn keys(lines: &[Self], theme: &Theme, canvas: &Canvas<'_>, (mut x, y): (i32, i32)) {
        for line in lines {
            let style = line.colour.stroke_width(line.width.max(3));
            let ends = if line.is_dashed {
                vec![[(x, y), (x + 8, y)], [(x + 13, y), (x + 21, y)]]
            } else {
                vec![[(x, y), (x + 21, y)]]
            };
            for end in ends {
                canvas.draw(&PathElement::new(end.to_vec(), style)).expect(DRAWN);
            }
            TextLine::new(13.0, theme.ink).put(canvas, &line.name, (x + 28, y));
            x += 28 + 22 + width(&line.name);
        }
    }
}

/// Draws keys of filled and outlined shapes in a row below the title.
///
/// # Panics
/// Never: drawing into a string does not fail.
pub fn keys_of_shapes(theme: &Theme, canvas: &Canvas<'_>, keys: &[(&str, ShapeStyle)]) {
    let mut x = 24;
    for (word, style) in keys {
        canvas.draw(&Rectangle::new([(x, 76), (x + 22, 86)], *style)).expect(DRAWN);
        TextLine::new(13.0, theme.ink).put(canvas, word, (x + 30, 82));
        x += 52 + width(word);
    }
}

/// Returns about how wide a text of 13 units is, whatever the viewer's font.
fn width(text: &str) -> i32 {
    i32::try_from(text.chars().count()).unwrap_or(i32::MAX / 8) * 6
}

/// Returns a figure without needless digits.
fn plain(value: f64) -> String {
    let rounded = (value * 1000.0).round() / 1000.0;
    // Adding 0 turns -0 into 0.
    format!("{}", rounded + 0.0).replace('-', "\u{2212}")
}
