// Elements. Texts of a trace are only ever set as text.

export const by = (id) => document.getElementById(id);

/** An element with attributes and children; a string is a text. */
export function el(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key === "class") element.className = value;
    else if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (value !== false && value !== undefined) element.setAttribute(key, value === true ? "" : value);
  }
  element.append(...children);
  return element;
}

/** A square of a source's colour. */
export const swatch = (place) => {
  const square = el("span", { class: "swatch", "aria-hidden": "true" });
  square.style.setProperty("--of", `var(--source-${tone(place)})`);
  return square;
};

/** Returns the index of a source's colour; 0 is local's. */
export const tone = (place) => (place === 0 ? 0 : ((place - 1) % 8) + 1);

/** The page's colours as they are now, light or dark. */
export function colours() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(`--${name}`).trim();
  const sources = Array.from({ length: 9 }, (_, i) => of(`source-${i}`));
  return {
    source: (place) => sources[tone(place)],
    ink: of("ink"), soft: of("soft"), line: of("line"), ground: of("ground"), panel: of("panel"),
    bad: of("bad"), warn: of("warn"), accent: of("accent"), open: of("open"),
  };
}
