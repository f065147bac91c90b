// Draws the figures of the page. Every figure is a plotly.js description whose colours are names of
// CSS variables ("--measured"), so that screen, dark screen and paper each have their own.
"use strict";

let figures; // descriptions by the id of their div
const divs = [...document.querySelectorAll(".plot")];
const touch = matchMedia("(pointer: coarse)").matches;

async function unpacked(id) {
  const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).text();
}

function coloured(value, style) {
  if (typeof value === "string") {
    return value.startsWith("--") ? style.getPropertyValue(value).trim() : value;
  }
  if (Array.isArray(value)) {
    return typeof value[0] === "number" ? value : value.map((item) => coloured(item, style));
  }
  if (value === null || typeof value !== "object") return value;
  return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, coloured(item, style)]));
}

// On a touch screen a finger scrolls the page until a zoom tool is chosen; Reset gives that back.
const reset = {
  name: "Reset",
  title: "Reset",
  icon: {
    width: 24, height: 24,
    path: "M12 5V1L7 6l5 5V7a6 6 0 1 1-6 6H4a8 8 0 1 0 8-8z",
  },
  click: (div) => Plotly.relayout(div, { ...whole(div), dragmode: touch ? false : "zoom" }),
};
const config = {
  responsive: false, // see resize() below: one handler for all figures
  displaylogo: false,
  displayModeBar: touch ? true : "hover",
  doubleClick: "reset",
  modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", reset, "toImage"]],
};

function whole(div) {
  const axes = Object.keys(div.layout).filter((key) => /^[xy]axis\d*$/.test(key));
  const first = figures[div.id].layout;
  return Object.fromEntries(axes.map((axis) =>
    first[axis].range ? [`${axis}.range`, [...first[axis].range]] : [`${axis}.autorange`, true]));
}

async function draw(div) {
  const first = !div.layout;
  const figure = coloured(figures[div.id], getComputedStyle(document.documentElement));
  if (!first && div.layout.xaxis.autorange === false) figure.layout.xaxis.range = div.layout.xaxis.range;
  figure.layout.width = div.clientWidth;
  figure.layout.dragmode = touch ? false : "zoom";
  await Plotly.react(div, figure.data, figure.layout, config);
  if (first) link(div);
}

// Figures side by side show the same stretch of time: zooming one zooms its neighbours.
function link(div) {
  const neighbours = [...div.closest(".row").querySelectorAll(".plot")].filter((other) => other !== div);
  div.on("plotly_relayout", (change) => {
    const from = change["xaxis.range[0]"], to = change["xaxis.range[1]"];
    const all = change["xaxis.autorange"];
    if (from === undefined && !all) return;
    for (const other of neighbours.filter((other) => other.layout)) {
      const range = other.layout.xaxis.range;
      if (from !== undefined && (range[0] !== from || range[1] !== to)) {
        Plotly.relayout(other, { "xaxis.range": [from, to] });
      } else if (all && !other.layout.xaxis.autorange) {
        Plotly.relayout(other, { "xaxis.autorange": true });
      }
    }
  });
}

function redraw() {
  divs.filter((div) => div.layout && div.clientWidth).forEach(draw);
}

async function drawAll() {
  for (const div of divs) {
    if (!div.layout && div.clientWidth) {
      await draw(div);
      await new Promise((next) => setTimeout(next)); // the page stays alive in between
    }
  }
}

function paper(on) {
  document.documentElement.classList.toggle("paper", on);
  divs.filter((div) => div.clientWidth).forEach(draw);
}

let pending;
function resize() {
  clearTimeout(pending);
  pending = setTimeout(redraw, 150);
}

async function start() {
  figures = JSON.parse(await unpacked("figures"));
  const script = document.createElement("script");
  script.textContent = await unpacked("plotly");
  document.head.append(script);
  await drawAll();
  for (const details of document.querySelectorAll("details")) {
    details.addEventListener("toggle", drawAll);
  }
  let width = innerWidth; // a phone's address bar changes the height only
  addEventListener("resize", () => {
    if (innerWidth !== width) resize();
    width = innerWidth;
  });
  addEventListener("beforeprint", () => paper(true));
  addEventListener("afterprint", () => paper(false));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
}

start().catch((error) => {
  console.error(error);
  document.getElementById("no-figures").hidden = false;
});
