// Charts of a run: its cells, the FRF of a cell, raw signals down to the sample; and trends of two axes.
"use strict";

(() => {
  const FONT = "13px system-ui, sans-serif";
  const wordsOf = (place) => JSON.parse(place.dataset.words);
  const soft = () => ballscrew.colour("soft");
  const line = () => ballscrew.colour("line");
  const { fetched } = ballscrew;

  const axis = (label, more) => ({
    stroke: soft, grid: { stroke: line, width: 1 }, ticks: { stroke: line, width: 1 }, label, labelSize: 24,
    font: FONT, labelFont: FONT, ...more,
  });
  const numbers = (decimals) => (_, values) => values.map((value) => (value === null ? "" : ballscrew.number(value, decimals)));
  const plainNumbers = (_, values) => values.map((value) => (value === null ? "" : value.toLocaleString(ballscrew.language, { maximumSignificantDigits: 6 })));
  const shown = (_, value) => (value === null || value === undefined ? "–" : value.toLocaleString(ballscrew.language, { maximumSignificantDigits: 7 }));

  function add(place, name) {
    const child = document.createElement("div");
    child.className = name;
    place.append(child);
    return child;
  }

  // A plot as wide as its place, in the colours of the page.
  function plot(place, height, options, data) {
    const chart = new uPlot({ width: ballscrew.widthOf(place), height, ...options }, data, place);
    ballscrew.fit(chart, place);
    ballscrew.recolours.push(() => chart.redraw());
    return chart;
  }

  function message(place, text) {
    place.textContent = "";
    const paragraph = add(place, "message");
    paragraph.setAttribute("role", "status");
    paragraph.textContent = text;
  }

  // --- cells -------------------------------------------------------------------------------------------------

  const MARKERS = { PA: [[0, -1], [0.9, 0.7], [-0.9, 0.7]], PD: [[0, 1], [0.9, -0.7], [-0.9, -0.7]], NA: [[1, 0], [-0.7, 0.9], [-0.7, -0.9]], ND: [[-1, 0], [0.7, 0.9], [0.7, -0.9]] };

  function drawMarker(context, condition, x, y, size, filled) {
    context.beginPath();
    MARKERS[condition].forEach(([dx, dy]) => context.lineTo(x + size * dx, y + size * dy));
    context.closePath();
    if (filled) context.fill();
    context.stroke();
  }

  // Points of one quantity of the cells: x beside the position by condition, value, half of the interval.
  function points(cells, conditions, value, uncertainty) {
    const places = [...new Set(cells.map((cell) => 1000 * cell.position_m))].sort((a, b) => a - b);
    const gaps = places.slice(1).map((x, n) => x - places[n]);
    const pitch = gaps.length ? Math.min(...gaps) : 10;
    return cells.map((cell) => ({
      x: 1000 * cell.position_m + 0.07 * pitch * (conditions.indexOf(cell.condition) - 1.5),
      y: cell[value], half: 1.96 * (cell[uncertainty] ?? 0), condition: cell.condition, verdict: cell.verdict,
    })).sort((a, b) => a.x - b.x);
  }

  function drawPoints(chart, listed, then) {
    const { ctx, bbox } = chart;
    const ratio = devicePixelRatio;
    ctx.save();
    ctx.lineWidth = 1.4 * ratio;
    for (const point of listed) {
      const x = chart.valToPos(point.x, "x", true);
      ctx.strokeStyle = ctx.fillStyle = then ? soft() : ballscrew.colour(point.condition);
      if (point.y === null) {
        if (then) continue;
        const [y, size] = [bbox.top + bbox.height - 6 * ratio, 4 * ratio];
        ctx.beginPath();
        ctx.moveTo(x - size, y - size); ctx.lineTo(x + size, y + size);
        ctx.moveTo(x + size, y - size); ctx.lineTo(x - size, y + size);
        ctx.stroke();
        continue;
      }
      ctx.beginPath();
      ctx.moveTo(x, chart.valToPos(point.y - point.half, "y", true));
      ctx.lineTo(x, chart.valToPos(point.y + point.half, "y", true));
      ctx.stroke();
      drawMarker(ctx, point.condition, x, chart.valToPos(point.y, "y", true), 5 * ratio, !then && point.verdict === "good");
    }
    ctx.restore();
  }

  function drawZero(chart) {
    const y = chart.valToPos(0, "y", true);
    chart.ctx.save();
    chart.ctx.strokeStyle = soft();
    chart.ctx.beginPath();
    chart.ctx.moveTo(chart.bbox.left, y);
    chart.ctx.lineTo(chart.bbox.left + chart.bbox.width, y);
    chart.ctx.stroke();
    chart.ctx.restore();
  }

  function cellPlot(place, height, label, layers, conditions, zero) {
    const listed = layers[0];
    const known = layers.flat().filter((point) => point.y !== null);
    const ends = known.flatMap((point) => [point.y - point.half, point.y + point.half]).concat(zero ? [0] : []);
    const margin = 0.06 * (Math.max(...ends) - Math.min(...ends)) || 1;
    const xs = listed.map((point) => point.x);
    const space = xs.length > 1 ? 0.03 * (xs[xs.length - 1] - xs[0]) || 5 : 5;
    const series = conditions.map((name) => ({ label: name, stroke: () => ballscrew.colour(name), points: { show: false }, paths: () => null, value: shown, width: 2 }));
    const data = [xs, ...conditions.map((name) => listed.map((point) => (point.condition === name ? point.y : null)))];
    plot(place, height, {
      scales: { x: { time: false, range: () => [xs[0] - space, xs[xs.length - 1] + space] }, y: { range: () => [Math.min(...ends) - margin, Math.max(...ends) + margin] } },
      axes: [axis(wordsOf(place.closest("[data-words]")).position, { values: plainNumbers }), axis(label, { size: 64, values: plainNumbers })],
      series: [{ value: shown, label: wordsOf(place.closest("[data-words]")).position }, ...series],
      cursor: { drag: { x: false, y: false }, points: { show: false } },
      hooks: { draw: [(chart) => { if (zero) drawZero(chart); layers.slice(1).forEach((layer) => drawPoints(chart, layer, true)); drawPoints(chart, listed, false); }] },
    }, data);
  }

  ballscrew.charts.cells = (place, data) => {
    const words = wordsOf(place);
    const conditions = Object.keys(data.colours);
    const now = points(data.cells, conditions, "frequency_Hz", "standard_uncertainty_Hz");
    if (!now.some((point) => point.y !== null)) return message(place, words.nothing);
    const layers = [now];
    if (data.against) layers.push(points(data.cells, conditions, "other_frequency_Hz", "other_uncertainty_Hz"));
    cellPlot(add(place, "panel"), 300, words.frequency, layers, conditions, false);
    const changed = data.cells.filter((cell) => cell.change_Hz !== null);
    if (changed.length) cellPlot(add(place, "panel"), 200, words.change, [points(changed, conditions, "change_Hz", "change_uncertainty_Hz")], conditions, true);
  };

  // --- FRF of a cell -----------------------------------------------------------------------------------------

  function shade(chart, from, to, colour, alpha) {
    const [left, right] = [from, to].map((x) => Math.min(Math.max(chart.valToPos(x, "x", true), chart.bbox.left), chart.bbox.left + chart.bbox.width));
    chart.ctx.save();
    chart.ctx.globalAlpha = alpha;
    chart.ctx.fillStyle = colour;
    chart.ctx.fillRect(left, chart.bbox.top, Math.max(right - left, devicePixelRatio), chart.bbox.height);
    chart.ctx.restore();
  }

  function responseSpan(data) {
    const [first, last] = [data.frequency_Hz[0], data.frequency_Hz[data.frequency_Hz.length - 1]];
    if (!data.band_Hz) return [first, last];
    const width = data.band_Hz[1] - data.band_Hz[0];
    return [Math.max(first, data.band_Hz[0] - 0.75 * width), Math.min(last, data.band_Hz[1] + 0.75 * width)];
  }

  async function drawResponse(place) {
    const words = wordsOf(place);
    let data;
    try {
      data = await fetched(place.dataset.source, (text) => message(place, text));
    } catch (error) {
      return message(place, error.message);
    }
    place.textContent = "";
    const span = responseSpan(data);
    const half = data.standard_uncertainty_Hz === null ? 0 : 1.96 * data.standard_uncertainty_Hz;
    const background = (chart) => {
      if (data.band_Hz) shade(chart, data.band_Hz[0], data.band_Hz[1], soft(), 0.08);
      if (data.natural_frequency_Hz !== null) shade(chart, data.natural_frequency_Hz - half, data.natural_frequency_Hz + half, ballscrew.colour("accent"), 0.35);
    };
    const sensors = ["#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#999999"];
    const panel = (height, label, scale, series, rows, more) => plot(add(place, "panel"), height, {
      scales: { x: { time: false, range: (_, low, high) => [low ?? span[0], high ?? span[1]], min: span[0], max: span[1] }, y: scale },
      axes: [axis(words.hertz, { values: plainNumbers }), axis(label, { size: 64, values: plainNumbers, ...more })],
      series: [{ label: words.hertz, value: shown }, ...series], cursor: { sync: { key: "response", scales: ["x", null] }, drag: { x: true } },
      bands: series.length === 3 && series[1].label === "−" ? [{ series: [3, 2], fill: () => `${ballscrew.colour("accent")}33` }] : [],
      hooks: { drawClear: [background] },
    }, [data.frequency_Hz, ...rows]);
    const known = data.magnitude.filter((value) => value > 0);
    const decades = (_, splits) => splits.map((value) => (Number.isInteger(Math.round(1e6 * Math.log10(value)) / 1e6) ? value : null));
    const edge = (factor) => data.magnitude.map((value, n) => (value === null ? null : Math.max(value * (1 + factor * data.relative_half_width[n]), value / 100)));
    const accent = () => ballscrew.colour("accent");
    const thin = { width: 0, points: { show: false }, value: shown };
    panel(280, `${words.magnitude}, ${data.estimator} (m/s² per ${data.input_unit})`, { distr: 3, range: () => [0.5 * Math.min(...known), 2 * Math.max(...known)] }, [
      { label: words.magnitude, stroke: accent, width: 2, value: shown, points: { show: false } },
      { ...thin, label: "−", stroke: accent }, { ...thin, label: "+", stroke: accent },
    ], [data.magnitude, edge(-1), edge(1)], { filter: decades });
    const sensor = (name, n) => ({ label: name || `${n + 1}`, stroke: sensors[n % sensors.length], width: 1.4, value: shown, points: { show: false } });
    panel(170, words.phase, { range: () => [-190, 190] }, data.responses.map(sensor), data.phase_deg, { splits: [-180, -90, 0, 90, 180] });
    panel(150, words.coherence, { range: () => [0, 1.05] }, data.responses.map(sensor), data.coherence, { splits: [0, 0.5, 1] });
  }

  // It is computed once somebody looks at it.
  const watch = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      watch.unobserve(entry.target);
      drawResponse(entry.target);
    }
  });

  // --- raw signals -------------------------------------------------------------------------------------------

  const INPUTS = ["torque", "force", "relative torque", "current"];

  function usual(channels) {
    const first = (test) => channels.find(test)?.name;
    const found = [first((each) => INPUTS.includes(each.quantity)), first((each) => each.quantity === "acceleration"), first((each) => each.quantity === "position")];
    return new Set(found.filter(Boolean).length ? found.filter(Boolean) : [channels[0].name]);
  }

  class Signals {
    constructor(place, about) {
      this.place = place;
      this.words = wordsOf(place);
      this.channels = about.channels;
      this.marks = JSON.parse(place.dataset.marks);
      this.whole = [Math.min(...about.channels.map((each) => each.begin_s)), Math.max(...about.channels.map((each) => each.begin_s + (each.samples - 1) / each.sample_rate_Hz))];
      const query = new URLSearchParams(location.search);
      const span = JSON.parse(place.dataset.span) ?? [query.get("from"), query.get("to")].map((text) => (text === null ? NaN : Number(text)));
      this.span = span.every(Number.isFinite) && span[0] < span[1] ? span : this.whole;
      const asked = query.getAll("channel").filter((name) => this.channels.some((each) => each.name === name));
      this.chosen = asked.length ? new Set(asked) : usual(this.channels);
      this.plots = new Map();
    }

    start() {
      this.place.textContent = "";
      const field = document.querySelector("[data-channels]");
      for (const each of this.channels) {
        const label = field.appendChild(document.createElement("label"));
        const box = label.appendChild(document.createElement("input"));
        box.type = "checkbox";
        box.checked = this.chosen.has(each.name);
        box.addEventListener("change", () => this.choose(each.name, box.checked));
        label.append(` ${each.name}`);
        if (each.not_finite) label.append(` (${each.not_finite} ${this.words.not_finite})`);
      }
      for (const button of document.querySelectorAll("[data-move]")) button.addEventListener("click", () => this.move(button.dataset.move));
      this.channels.filter((each) => this.chosen.has(each.name)).forEach((each) => this.open(each));
      return this.load();
    }

    choose(name, wanted) {
      if (wanted) this.chosen.add(name);
      else this.chosen.delete(name);
      this.plots.get(name)?.panel.remove();
      this.plots.get(name)?.chart.destroy();
      this.plots.delete(name);
      if (wanted) this.open(this.channels.find((each) => each.name === name));
      this.load();
    }

    move(how) {
      const [from, to] = this.span;
      const [middle, width] = [(from + to) / 2, to - from];
      const spans = { in: [middle - width / 4, middle + width / 4], out: [middle - width, middle + width], back: [from - width / 2, to - width / 2], on: [from + width / 2, to + width / 2], all: this.whole };
      this.show(spans[how]);
    }

    show([from, to]) {
      const least = 4 / Math.max(...this.channels.map((each) => each.sample_rate_Hz));
      const width = Math.min(Math.max(to - from, least), this.whole[1] - this.whole[0]);
      const begin = Math.min(Math.max(from, this.whole[0]), this.whole[1] - width);
      this.span = [begin, begin + width];
      this.load();
    }

    open(channel) {
      const panel = add(this.place, "panel");
      const order = this.channels.map((each) => each.name);
      const later = [...this.plots.entries()].find(([name]) => order.indexOf(name) > order.indexOf(channel.name));
      if (later) this.place.insertBefore(panel, later[1].panel);
      const heading = panel.appendChild(document.createElement("h2"));
      heading.textContent = channel.name;
      const canvas = add(panel, "plot");
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", channel.name);
      const accent = () => ballscrew.colour("accent");
      const series = { stroke: accent, width: 1, value: shown, points: { show: (chart) => chart.data[0].length < chart.bbox.width / devicePixelRatio / 6, size: 5, fill: accent } };
      const chart = plot(canvas, 200, {
        scales: { x: { time: false, range: () => this.span } },
        axes: [axis(this.words.seconds, { values: plainNumbers, space: 90 }), axis(channel.unit, { size: 76, values: plainNumbers })],
        series: [{ label: this.words.seconds, value: shown }, { ...series, label: this.words.low }, { ...series, label: this.words.high }],
        bands: [{ series: [2, 1], fill: accent }],
        cursor: { sync: { key: "signals", scales: ["x", null] }, drag: { x: true, setScale: false }, bind: { dblclick: () => () => this.show(this.whole) } },
        hooks: { drawClear: [(each) => this.shadeMarks(each)], setSelect: [(each) => this.select(each)] },
      }, [[], [], []]);
      this.plots.set(channel.name, { panel, chart });
      this.plots = new Map([...this.plots.entries()].sort((a, b) => order.indexOf(a[0]) - order.indexOf(b[0])));
    }

    select(chart) {
      const { left, width } = chart.select;
      chart.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      if (width > 3) this.show([chart.posToVal(left, "x"), chart.posToVal(left + width, "x")]);
    }

    shadeMarks(chart) {
      for (const mark of this.marks) {
        if (mark.stop_s < this.span[0] || mark.start_s > this.span[1]) continue;
        shade(chart, mark.start_s, mark.stop_s, ballscrew.colour(mark.condition) || soft(), mark.repetition ? 0.18 : 0.07);
      }
    }

    async load() {
      this.aborting?.abort();
      this.aborting = new AbortController();
      this.state();
      const { signal } = this.aborting;
      await Promise.all([...this.plots].map(async ([name, { chart }]) => {
        const points = Math.max(2, Math.min(10000, Math.round(chart.bbox.width / devicePixelRatio) || 800));
        const query = new URLSearchParams({ channel: name, from: this.span[0], to: this.span[1], points });
        let waited = false;
        const wait = (text) => {
          waited = true;
          this.announce(text);
        };
        try {
          const part = await fetched(`${this.place.dataset.source}&${query}`, wait, signal);
          if (signal.aborted) return;
          chart.setData([part.time_s, part.low, part.high ?? part.low]);
          if (waited) this.state();
        } catch (error) {
          if (error.name !== "AbortError") this.announce(error.message);
        }
      }));
    }

    state() {
      const decimals = Math.min(6, Math.max(0, Math.ceil(2 - Math.log10(this.span[1] - this.span[0]))));
      this.announce(this.span.map((each) => `${ballscrew.number(each, decimals)} s`).join(" … "));
      const query = new URLSearchParams(location.search);
      query.delete("channel");
      query.delete("cell");
      query.set("file", new URLSearchParams(this.place.dataset.source.split("?")[1]).get("file"));
      query.set("from", this.span[0]);
      query.set("to", this.span[1]);
      for (const name of this.plots.keys()) query.append("channel", name);
      history.replaceState(null, "", `?${query}`);
    }

    announce(text) {
      document.querySelector("[data-shown]").textContent = text;
    }
  }

  ballscrew.charts.signals = (place, about) => new Signals(place, about).start();

  // --- trends of two axes ------------------------------------------------------------------------------------

  ballscrew.charts.trends = async (place, first, wait) => {
    const words = wordsOf(place);
    const both = [first, await fetched(place.dataset.other, wait)];
    const tables = both.map(({ history }) => {
      const rows = history.filter((row) => row.measured_at && row.stiffness !== null);
      return [rows.map((row) => ballscrew.instant(row.measured_at).getTime() / 1000), ...["stiffness", "stiffness_low", "stiffness_high"].map((name) => rows.map((row) => 100 * row[name]))];
    });
    if (!tables.some((table) => table[0].length)) return message(place, words.nothing);
    const colours = [() => ballscrew.colour("accent"), () => ballscrew.colour("watch")];
    const series = both.flatMap(({ axis: name }, n) => [
      { label: name.slice(0, 60), stroke: colours[n], width: 2, value: shown, spanGaps: true, dash: n ? [6, 4] : undefined },
      { label: "−", stroke: colours[n], width: 0, points: { show: false }, value: shown, spanGaps: true },
      { label: "+", stroke: colours[n], width: 0, points: { show: false }, value: shown, spanGaps: true },
    ]);
    plot(add(place, "panel"), 380, {
      axes: [axis(words.day), axis(words.preload, { size: 64, values: numbers(0) })],
      series: [{ label: words.day, value: (_, value) => (value === null ? "–" : ballscrew.clock.format(new Date(1000 * value))) }, ...series],
      bands: [0, 1].map((n) => ({ series: [3 + 3 * n, 2 + 3 * n], fill: () => `${colours[n]()}26` })),
    }, uPlot.join(tables));
  };

  // --- the rest of the page ----------------------------------------------------------------------------------

  const observe = (root) => root.querySelectorAll("[data-later]").forEach((place) => watch.observe(place));

  document.addEventListener("DOMContentLoaded", () => {
    observe(document);
    document.body.addEventListener("htmx:afterSwap", (event) => observe(event.target));
    for (const button of document.querySelectorAll("[data-copy]")) {
      button.addEventListener("click", async () => {
        await navigator.clipboard.writeText(document.getElementById(button.dataset.copy).textContent);
        button.textContent = button.dataset.copied;
      });
    }
    document.querySelector("[data-signals-form]")?.addEventListener("change", (event) => event.currentTarget.submit());
  });
})();
