// Numbers for people.

const grouped = new Intl.NumberFormat("en-GB");

/** A count: 12,345. */
export const count = (n) => grouped.format(n);

/** A count with what it counts. */
export const counted = (n, what) => `${count(n)} ${what}${n === 1 ? "" : "s"}`;

/** A quantile of response times; `never` if too many messages have no output. */
export const quantile = (ns) => (typeof ns === "string" ? ns : time(ns ?? NaN));

/** A share in percent. */
export const share = (part, whole) => (whole ? `${((100 * part) / whole).toFixed(1)} %` : "–");

const UNITS = [[1e9, "s"], [1e6, "ms"], [1e3, "µs"], [1, "ns"]];

/** A duration in nanoseconds with about three digits: 412 ms. */
export function time(ns) {
  if (!Number.isFinite(ns)) return "–";
  if (ns === 0) return "0";
  const size = Math.abs(ns);
  // A number that is rounded to 1000 of a unit is 1 of the next one.
  if (size >= 3.6e12) return `${trim(ns / 3.6e12, 2)}\u00a0h`;
  const [unit, name] = UNITS.find(([unit]) => size >= 0.9995 * unit) ?? UNITS[3];
  const digits = size / unit >= 100 || unit === 1 ? 0 : size / unit >= 10 ? 1 : 2;
  return `${trim(ns / unit, digits)}\u00a0${name}`;
}

/** Labels of an axis with these steps, all in one unit. */
export function axis(values, step) {
  if (step >= 6e10) return values.map((v) => clock(Math.round(v / 6e10)));
  const digitsOf = (unit) => [0, 1, 2, 3].find((digits) => {
    const last = (step / unit) * 10 ** digits;
    return last > 0.5 && Math.abs(last - Math.round(last)) < 1e-6;
  });
  // The greatest unit that the greatest value reaches and that tells the steps apart.
  const most = Math.max(...values.map(Math.abs));
  const [unit, name] = UNITS.find(([unit]) => most >= unit && digitsOf(unit) !== undefined)
    ?? UNITS.find(([unit]) => step >= unit) ?? UNITS[3];
  const digits = digitsOf(unit) ?? 3;
  return values.map((v) => `${grouped.format(trim(v / unit, digits))} ${name}`);
}

/** Minutes as h:mm, with the unit. */
const clock = (minutes) =>
  minutes < 60 ? `${minutes} min` : `${grouped.format(Math.floor(minutes / 60))}:${String(minutes % 60).padStart(2, "0")} h`;

const trim = (n, digits) => Number(n.toFixed(digits)).toString();
