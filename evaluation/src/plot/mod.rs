//! Plots: one drawing, on light and on dark ground, as SVG and as PNG, and a page that holds them.

mod chart;
mod cut;
mod folder;
mod page;
mod png;
mod theme;

pub(crate) use chart::{Axes, Canvas, ChartLine, DRAWN, TextLine, canvas, logarithmic, width};
pub(crate) use cut::{inside, pieces};
pub(crate) use folder::{Folder, PageContent, show};
pub(crate) use page::PlotPage;
pub(crate) use png::png;
pub(crate) use theme::{DARK, LIGHT, Theme};

/// A drawing on some ground, as SVG.
pub(crate) struct Plot {
    /// The name of its files.
    pub(crate) name: &'static str,
    /// What it shows, in a sentence.
    pub(crate) caption: String,
    draw: Box<dyn Fn(&Theme) -> String>,
}

impl Plot {
    /// A plot that draws itself.
    pub(crate) fn new(
        name: &'static str,
        caption: impl Into<String>,
        draw: impl Fn(&Theme) -> String + 'static,
    ) -> Self {
        Self { name, caption: caption.into(), draw: Box::new(draw) }
    }

    pub(crate) fn svg(&self, theme: &Theme) -> String {
        (self.draw)(theme)
    }
}
