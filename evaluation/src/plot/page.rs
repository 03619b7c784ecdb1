//! Writes a page with plots and text that needs no network.

use std::fmt::Write;

const HEAD: &str = r#"<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>@@</title>
<style>
:root { color-scheme: light dark; --ground: #f6f7f9; --panel: #ffffff; --ink: #1d2530; --soft: #5d6875; --line: #e2e6eb; }
@media (prefers-color-scheme: dark) { :root { --ground: #12161b; --panel: #1a2027; --ink: #e4e8ed; --soft: #9aa5b1; --line: #2a323b; } }
* { box-sizing: border-box; }
html { background: var(--ground); color: var(--ink); font: 15px/1.5 Inter, system-ui, sans-serif; }
body { max-width: 1000px; margin: 0 auto; padding: 24px 16px 64px; }
h1 { font-size: 24px; margin: 0 0 8px; }
p { margin: 0 0 16px; max-width: 74ch; }
figure { margin: 0 0 24px; padding: 12px; background: var(--panel); border: 1px solid var(--line); border-radius: 10px; }
figure svg { display: block; width: 100%; height: auto; }
figcaption { color: var(--soft); font-size: 14px; padding: 8px 12px 4px; }
pre { overflow-x: auto; padding: 14px 16px; background: var(--panel); border: 1px solid var(--line); border-radius: 10px; font: 12.5px/1.45 ui-monospace, "DejaVu Sans Mono", monospace; }
@media (max-width: 640px) { figure > div { overflow-x: auto; } figure svg { width: 560px; max-width: none; } figure::before { content: "⇄ swipe"; display: block; text-align: right; color: var(--soft); font-size: 13px; } }
.dark { display: none; }
@media (prefers-color-scheme: dark) { .dark { display: block; } .light { display: none; } }
</style>
"#;

pub(super) struct PlotPage<'a> {
    pub(super) title: &'a str,
    /// The text, by paragraph.
    pub(super) words: &'a [&'a str],
    /// From top to bottom: a caption, and the SVG on light and on dark ground.
    pub(super) figures: &'a [(&'a str, [String; 2])],
    /// The table of the terminal.
    pub(super) table: &'a str,
}

impl PlotPage<'_> {
    pub(super) fn html(&self) -> String {
        let mut html = HEAD.replace("@@", &escaped(self.title));
        // Writing to a string does not fail.
        let _ = writeln!(html, "<h1>{}</h1>", escaped(self.title));
        for words in self.words {
            let _ = writeln!(html, "<p>{}</p>", escaped(words));
        }
        for (caption, [light, dark]) in self.figures {
            let caption = escaped(caption);
            let _ = writeln!(
                html,
                "<figure role=\"img\" aria-label=\"{caption}\"><div class=\"light\">{light}</div><div class=\"dark\">{dark}</div>\n\
                 <figcaption>{caption}</figcaption></figure>"
            );
        }
        let _ = writeln!(html, "<pre>{}</pre>", escaped(self.table));
        html.push_str("</html>\n");
        html
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
