//! Draws each shape twice: into an SVG, and into the pixels of a picture.

use std::io::Error;

use plotters::prelude::{DrawingBackend, SVGBackend};
use plotters_backend::{
    BackendColor, BackendCoord as Place, BackendStyle, BackendTextStyle, DrawingErrorKind,
};

use crate::plot::picture::Picture;

/// A sheet of paper that plotters draws on.
pub struct Sheet<'a> {
    svg: SVGBackend<'a>,
    picture: &'a mut Picture,
}

/// The result of drawing a shape.
type Drawn = Result<(), DrawingErrorKind<Error>>;

impl<'a> Sheet<'a> {
    /// Creates a sheet of this width and height.
    pub(super) fn new(svg: &'a mut String, picture: &'a mut Picture, size: (u32, u32)) -> Self {
        Self { svg: SVGBackend::with_string(svg, size), picture }
    }
}

impl DrawingBackend for Sheet<'_> {
    type ErrorType = Error;

    fn get_size(&self) -> (u32, u32) {
        self.svg.get_size()
    }

    fn ensure_prepared(&mut self) -> Drawn {
        self.svg.ensure_prepared()
    }

    fn present(&mut self) -> Drawn {
        self.svg.present()
    }

    fn draw_pixel(&mut self, (x, y): Place, colour: BackendColor) -> Drawn {
        self.picture.rectangle((x, y), (x + 1, y + 1), &colour, true);
        self.svg.draw_pixel((x, y), colour)
    }

    fn draw_line<S: BackendStyle>(&mut self, from: Place, to: Place, style: &S) -> Drawn {
        self.picture.line(&[from, to], style);
        self.svg.draw_line(from, to, style)
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        upper_left: Place,
        lower_right: Place,
        style: &S,
        fill: bool,
    ) -> Drawn {
        self.picture.rectangle(upper_left, lower_right, style, fill);
        self.svg.draw_rect(upper_left, lower_right, style, fill)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = Place>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Drawn {
        let places: Vec<Place> = path.into_iter().collect();
        self.picture.line(&places, style);
        self.svg.draw_path(places, style)
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        centre: Place,
        radius: u32,
        style: &S,
        fill: bool,
    ) -> Drawn {
        self.picture.circle(centre, radius, style, fill);
        self.svg.draw_circle(centre, radius, style, fill)
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = Place>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Drawn {
        let corners: Vec<Place> = corners.into_iter().collect();
        self.picture.fill(&corners, style);
        self.svg.fill_polygon(corners, style)
    }

    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: Place) -> Drawn {
        self.picture.text(text, style, at);
        self.svg.draw_text(text, style, at)
    }
}
