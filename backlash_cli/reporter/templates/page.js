"use strict";
(() => {
  const all = (selector, root = document) => Array.from(root.querySelectorAll(selector));

  // Tables: a click on a heading sorts; numbers by size, text by the alphabet, empty cells last.
  const number = /^-?(\d|\.\d)/;
  const compare = (a, b) => {
    if (a === "" || b === "") return (a === "") - (b === "");
    if (number.test(a) && number.test(b) && !isNaN(a) && !isNaN(b)) return a - b;
    return a.localeCompare(b, undefined, { numeric: true, sensitivity: "base" });
  };
  const sortBy = (table, column, direction) => {
    const body = table.tBodies[0];
    const keyed = all("tr", body).map((row, i) => [row.cells[column].dataset.key, i, row]);
    keyed.sort(([a, i], [b, j]) => {
      const order = compare(a, b);
      return a === "" || b === "" ? order || i - j : direction * order || i - j;
    });
    body.append(...keyed.map((k) => k[2]));
    all("th", table).forEach((th, i) => {
      if (i === column) th.setAttribute("aria-sort", direction > 0 ? "ascending" : "descending");
      else th.removeAttribute("aria-sort");
    });
  };
  for (const table of all("main table")) {
    all("thead th", table).forEach((th, column) => {
      const numeric = all("tbody tr", table).some((row) => row.cells[column].classList.contains("number"));
      if (numeric) all(`tr > :nth-child(${column + 1})`, table).forEach((cell) => cell.classList.add("number"));
      if (!table.classList.contains("sortable")) return;
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = th.textContent;
      th.textContent = "";
      th.append(button);
      button.addEventListener("click", () => {
        const now = th.getAttribute("aria-sort");
        sortBy(table, column, now === "ascending" ? -1 : now === "descending" ? 1 : numeric ? -1 : 1);
      });
    });
  }

  // Search box and list of choices.
  for (const form of all("form.filter")) {
    const table = form.nextElementSibling.querySelector("table");
    const text = form.querySelector(".filter-text");
    const choice = form.querySelector(".filter-choice");
    const count = form.querySelector(".filter-count");
    const rows = all("tbody tr", table);
    const words = rows.map((row) => row.textContent.toLowerCase());
    const kind = (row) => (choice ? row.cells[choice.dataset.column].textContent : "");
    if (choice) {
      for (const value of Array.from(new Set(rows.map(kind))).sort()) choice.add(new Option(value, value));
    }
    const apply = () => {
      const wanted = text.value.toLowerCase().split(/\s+/).filter(Boolean);
      let shown = 0;
      rows.forEach((row, i) => {
        row.hidden = !(wanted.every((w) => words[i].includes(w)) && (!choice || !choice.value || choice.value === kind(row)));
        shown += !row.hidden;
      });
      count.textContent = shown === rows.length ? `${shown} rows` : `${shown} of ${rows.length} rows`;
    };
    form.addEventListener("input", apply);
    form.addEventListener("submit", (event) => event.preventDefault());
    apply();
  }

  // Figures, in the colours of the page: drawn as soon as they are there, those of a folded section when it is opened.
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const themed = (layout) => {
    const out = Object.assign({}, layout, {
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      margin: Object.assign({ t: layout.title ? 50 : 30, r: 15, l: 50, b: 50 }, layout.margin),
      legend: Object.assign({ orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, layout.legend),
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("--quiet"), activecolor: colour("--text") },
      font: Object.assign({ size: 13 }, layout.font, { color: colour("--text"), family: "system-ui, sans-serif" }),
    });
    delete out.template;
    const axes = new Set(["xaxis", "yaxis", ...Object.keys(layout).filter((k) => /^[xy]axis\d*$/.test(k))]);
    for (const axis of axes) {
      out[axis] = Object.assign({}, layout[axis], {
        gridcolor: colour("--grid"), zerolinecolor: colour("--line"), linecolor: colour("--line"), automargin: true,
        title: Object.assign({ font: { size: 13 } }, (layout[axis] || {}).title),
      });
    }
    return out;
  };
  const unpack = async (packed) => {
    const bytes = Uint8Array.from(atob(packed.textContent), (letter) => letter.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  };
  const plots = all(".plot");
  const waiting = new Map();
  const figures = new Map();
  const draw = (plot) => {
    const figure = waiting.get(plot);
    if (!figure) return;
    waiting.delete(plot);
    figures.set(plot, figure);
    const layout = themed(figure.layout || {});
    if (window.innerWidth < 640) {  // the legend takes a line per name, and there is room for few dates
      const named = figure.data.filter((trace) => trace.name && trace.showlegend !== false).length;
      layout.height = (layout.height || 450) + 18 * named;
      Object.keys(layout).filter((k) => k.startsWith("xaxis")).forEach((k) => Object.assign(layout[k], { nticks: 4, tickangle: 0 }));
    }
    plot.style.height = `${layout.height || 450}px`;  // else a window of another size leaves only the least height
    window.Plotly.newPlot(plot, figure.data, layout, {
      responsive: true, displaylogo: false, scrollZoom: false,
      modeBarButtons: [["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
    });
  };
  const seen = new IntersectionObserver((entries) => {
    for (const entry of entries) if (entry.isIntersecting) { seen.unobserve(entry.target); draw(entry.target); }
  }, { rootMargin: "300px" });
  const prepare = async () => {
    const packed = document.getElementById("plotly");
    if (packed) {
      const library = document.createElement("script");
      library.textContent = await unpack(packed);
      packed.replaceWith(library);
    }
    JSON.parse(await unpack(document.getElementById("figures"))).forEach((figure, i) => waiting.set(plots[i], figure));
    plots.forEach((plot) => seen.observe(plot));
    for (const plot of plots.filter((one) => !one.closest("details:not([open])"))) {
      draw(plot);
      await new Promise((resolve) => setTimeout(resolve));  // between two figures the page answers to its reader
    }
  };
  // Where it cannot be done, the page's style says so in the place of each figure. The page counts as loaded when they
  // are there, or a program that prints it then would find none: an open document holds it up.
  if (plots.length && window.DecompressionStream) {
    const hold = document.body.appendChild(document.createElement("iframe"));
    const words = document.documentElement.classList;
    words.add("drawing");
    hold.hidden = true;
    hold.contentDocument.open();
    prepare().catch(() => words.remove("drawing")).finally(() => { hold.contentDocument.close(); hold.remove(); });
  }
  const recolour = () => figures.forEach((figure, plot) => {
    const view = themed(Object.assign({}, plot.layout));
    window.Plotly.relayout(plot, view);
  });
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);

  // Folded sections: a link opens its target; printing opens them all.
  const reveal = () => {
    const target = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (target) {
      for (let node = target; node; node = node.parentElement) if (node.tagName === "DETAILS") node.open = true;
      target.scrollIntoView();
    }
  };
  window.addEventListener("hashchange", reveal);
  reveal();
  let opened = [];
  window.addEventListener("beforeprint", () => {
    opened = all("details:not([open])");
    if (opened.length <= 60) opened.forEach((d) => { d.open = true; }); else opened = [];
    plots.filter((one) => !one.closest("details:not([open])")).forEach(draw);
    figures.forEach((_, plot) => window.Plotly.relayout(plot, { width: 700 }));  // of A4 and of letter paper
  });
  window.addEventListener("afterprint", () => {
    opened.forEach((d) => { d.open = false; });
    figures.forEach((_, plot) => window.Plotly.relayout(plot, { width: null, autosize: true }));
  });
})();
