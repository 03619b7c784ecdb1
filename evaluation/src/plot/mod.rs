//! Plots: one drawing, on light and on dark ground, as SVG and as PNG, and a page that holds them.

mod chart;
mod cut;
mod folder;
mod page;
mod picture;
mod sheet;
mod theme;

pub use chart::{
    Axes, Canvas, Chart, ChartLine, DRAWN, LogPoints, Scale, TextLine, canvas, keys_of_shapes,
    logarithmic,
};
use cut::pieces;
pub use folder::{Folder, FolderError, PageContent, page_of, show};
use page::PlotPage;
pub use sheet::Sheet;
pub use theme::{DARK, LIGHT, Theme};

/// A plot that can be drawn on either ground.
pub struct Plot {
    /// The name of its files.
    pub name: &'static str,
    /// The caption.
    pub caption: String,
    draw: Box<dyn Fn(&Theme) -> Drawing>,
}

/// A plot on one ground.
pub struct Drawing {
    /// The text of its SVG.
    pub svg: String,
    /// The bytes of its PNG, which has two pixels for a unit of the SVG.
    pub png: Vec<u8>,
}

impl Plot {
    /// Returns a plot that draws itself.
    pub fn new(
        name: &'static str,
        caption: impl Into<String>,
        draw: impl Fn(&Theme) -> Drawing + 'static,
    ) -> Self {
        Self { name, caption: caption.into(), draw: Box::new(draw) }
    }

    /// Draws it on a ground.
    #[must_use]
    pub fn on(&self, theme: &Theme) -> Drawing {
        (self.draw)(theme)
    }
}
