//! Plots: one drawing, on light and on dark ground, as SVG and as PNG, and a page that holds them.

mod chart;
mod cut;
mod folder;
mod page;
mod png;
mod theme;

pub use chart::{
    Axes, Canvas, Chart, ChartLine, DRAWN, LogPoints, Scale, TextLine, canvas, logarithmic, width,
};
pub use cut::inside;
use cut::pieces;
pub use folder::{Folder, FolderError, PageContent, show};
use page::PlotPage;
use png::png;
pub use theme::{DARK, LIGHT, Theme};

/// A drawing on some ground, as SVG.
pub struct Plot {
    /// The name of its files.
    pub name: &'static str,
    /// What it shows, in a sentence.
    pub caption: String,
    draw: Box<dyn Fn(&Theme) -> String>,
}

impl Plot {
    /// A plot that draws itself.
    pub fn new(
        name: &'static str,
        caption: impl Into<String>,
        draw: impl Fn(&Theme) -> String + 'static,
    ) -> Self {
        Self { name, caption: caption.into(), draw: Box::new(draw) }
    }

    /// Draws it on a ground.
    #[must_use]
    pub fn svg(&self, theme: &Theme) -> String {
        (self.draw)(theme)
    }
}
