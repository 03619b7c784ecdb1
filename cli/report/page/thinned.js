// What the page does not show of a trace that is too long for it, and how to see that.

import { MISSED } from "./data.js";
import { by } from "./dom.js";
import { count, counted } from "./format.js";

export function showThinned({ thinned, besides, outcome, length }) {
  by("thinned").hidden = !thinned;
  if (!thinned) return;
  const { every, timestamps, events, error } = thinned;
  const more = { missed: 0, broken: 0 };
  outcome.forEach((one, k) => besides[k] && more[one === MISSED ? "missed" : "broken"]++);
  const others = [more.broken && `${count(more.broken)} more that break a rule`, more.missed && `${count(more.missed)} more that were missed`].filter(Boolean);
  const lower = error ? ` Response times and quantiles are at most ${Number((100 * error).toPrecision(1))} % too low.` : "";
  by("thinned").textContent = `All ${counted(events, "event")} of ${counted(timestamps, "timestamp")} are judged and counted, and the strip is of all. `
    + `The page holds ${count(length)} of the events: one timestamp in ${count(every)}${others.map((one) => `, ${one}`).join("")}. `
    + `fuseline report --from 10m --to 12m shows all of two minutes, --timestamps 1000..2000 all of these timestamps.${lower}`;
}
