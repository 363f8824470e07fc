// Charts of an axis: linked zoom and hover, a readout that the keyboard moves, and a map along the axis.
"use strict";

(() => {
  const STATES = ["learning", "normal", "watch", "alarm", "unloaded", "suspect", "unknown"];
  const SIGNS = { learning: "▼", normal: "●", watch: "◆", alarm: "■", unloaded: "✖", suspect: "✚", unknown: "○" };
  const HIGHEST = 100; // times the alarm limit
  const DAY = 86400; // s
  const MANY = 150; // runs from which on each is small
  const NEAR = 14; // pixels from a point within which a click opens it
  const DOUBLE = 280; // ms to wait for the second click
  const view = { full: null, now: null };
  const plots = [];
  let palette = {};
  let words = {};
  let trend = null;

  const element = (id) => document.getElementById(id);
  const opened = (run) => location.assign(`/runs/${encodeURIComponent(run)}`);
  const seconds = (text) => ballscrew.instant(text).getTime() / 1000;
  const finite = (values) => values.filter((value) => value !== null && Number.isFinite(value));
  const least = (values) => values.reduce((a, b) => Math.min(a, b), Infinity); // spread, many numbers exceed the stack
  const most = (values) => values.reduce((a, b) => Math.max(a, b), -Infinity);

  function readPalette() {
    const names = ["text", "soft", "line", "back", "panel", "accent", "alarm", ...STATES.map((each) => `fill-${each}`)];
    palette = Object.fromEntries(names.map((name) => [name, ballscrew.colour(name)]));
  }

  // ---- what all charts have -------------------------------------------------------------------------------

  function extend(low, high) {
    const margin = Math.max((high - low) * 0.02, 3 * DAY);
    const [begin, end] = view.full ?? [Infinity, -Infinity];
    view.full = [Math.min(begin, low - margin), Math.max(end, high + margin)];
  }

  function zoom(span) {
    view.now = span;
    const [min, max] = span ?? view.full;
    for (const plot of plots) plot.setScale("x", { min, max });
    for (const button of document.querySelectorAll(".spans button"))
      button.setAttribute("aria-pressed", String(span === null && button.dataset.days === "0"));
  }

  function dates(plot, splits, axis, space, step) {
    const parts = step >= 300 * DAY ? { year: "numeric" } : step >= 25 * DAY ? { year: "2-digit", month: "short" } : { day: "numeric", month: "short" };
    const day = new Intl.DateTimeFormat(ballscrew.language, parts);
    const hour = new Intl.DateTimeFormat(ballscrew.language, { hour: "2-digit", minute: "2-digit" });
    return splits.map((each) => {
      const at = new Date(1000 * each);
      return step < DAY && at.getHours() + at.getMinutes() > 0 ? hour.format(at) : day.format(at);
    });
  }

  function axisOf(options = {}) {
    const font = "12px system-ui, sans-serif";
    return { stroke: () => palette.soft, grid: { stroke: () => palette.line, width: 1 }, ticks: { show: false }, font, ...options };
  }

  // A chart of columns over time in a place; ``runs`` are the ids of its points.
  function chart(place, runs, columns, options) {
    const height = Number(place.dataset.height);
    const plot = new uPlot(
      {
        width: ballscrew.widthOf(place),
        height,
        legend: { show: false },
        padding: [8, 24, 0, 0],
        scales: { x: { time: true }, y: options.scale },
        axes: [axisOf({ values: dates, space: 70, size: 26, ...options.dates }), axisOf({ size: 64, space: 22, ...options.axis })],
        series: [{}, ...options.series],
        cursor: {
          y: false,
          drag: { x: true, y: false, setScale: false },
          sync: { key: "axis", setSeries: false, filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } },
          bind: { dblclick: () => () => (zoom(null), null) },
        },
        hooks: {
          drawClear: [(each) => clipped(each, options.behind)],
          draw: [(each) => clipped(each, options.front)],
          setCursor: [(each) => options.hover?.(each)],
          setSelect: [
            (each) => {
              const { left, width: wide } = each.select;
              if (wide < 4) return;
              const span = [each.posToVal(left, "x"), each.posToVal(left + wide, "x")];
              each.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
              zoom(span);
            },
          ],
        },
      },
      columns,
      place,
    );
    plot.runs = runs;
    let [pressed, waiting] = [0, null];
    plot.over.addEventListener("mousedown", (event) => (pressed = event.clientX));
    plot.over.addEventListener("click", (event) => {
      const { idx, left } = plot.cursor;
      clearTimeout(waiting);
      if (event.detail > 1 || !plot.runs[idx] || Math.abs(event.clientX - pressed) > 3) return;
      const away = Math.abs(plot.valToPos(plot.data[0][idx], "x") - left);
      if (away < (options.reach ?? NEAR)) waiting = setTimeout(() => opened(plot.runs[idx]), DOUBLE);
    });
    ballscrew.fit(plot, place);
    plots.push(plot);
    return plot;
  }

  function clipped(plot, draw) {
    if (!draw) return;
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.textAlign = "left";
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    draw(plot, ctx, (value) => plot.valToPos(value, "x", true), (value) => plot.valToPos(value, "y", true));
    ctx.restore();
  }

  // Draw a chart, or give the one that is there new columns; the span of time stays.
  function update(place, runs, columns, options) {
    const known = plots.find((plot) => plot.root.parentNode === place);
    if (!known) return chart(place, runs, columns, options);
    known.runs = runs;
    known.setData(columns, false);
    return known;
  }

  const ratio = () => window.devicePixelRatio || 1;

  function line(ctx, x0, y0, x1, y1) {
    ctx.beginPath();
    ctx.moveTo(x0, y0);
    ctx.lineTo(x1, y1);
    ctx.stroke();
  }

  // ---- shapes ---------------------------------------------------------------------------------------------

  const SHAPES = {
    normal: (ctx, x, y, r) => ctx.arc(x, y, r, 0, 7),
    learning: (ctx, x, y, r) => polygon(ctx, [[x - r, y - r], [x + r, y - r], [x, y + r]]),
    watch: (ctx, x, y, r) => polygon(ctx, [[x, y - 1.4 * r], [x + 1.4 * r, y], [x, y + 1.4 * r], [x - 1.4 * r, y]]),
    alarm: (ctx, x, y, r) => ctx.rect(x - r, y - r, 2 * r, 2 * r),
    unloaded: (ctx, x, y, r) => cross(ctx, x, y, r, Math.PI / 4),
    suspect: (ctx, x, y, r) => cross(ctx, x, y, r, 0),
    unknown: (ctx, x, y, r) => ctx.arc(x, y, r, 0, 7),
  };

  function polygon(ctx, points) {
    points.forEach(([x, y], place) => (place ? ctx.lineTo(x, y) : ctx.moveTo(x, y)));
    ctx.closePath();
  }

  function cross(ctx, x, y, r, turn) {
    const [a, b] = [1.3 * r * Math.cos(turn), 1.3 * r * Math.sin(turn)];
    for (const [dx, dy] of [[a, b], [-b, a]]) {
      ctx.moveTo(x - dx, y - dy);
      ctx.lineTo(x + dx, y + dy);
    }
  }

  function shape(ctx, state, x, y, r) {
    ctx.beginPath();
    (SHAPES[state] ?? SHAPES.unknown)(ctx, x, y, r);
    if (state === "unloaded" || state === "suspect" || state === "unknown") ctx.stroke();
    else ctx.fill();
  }

  // ---- preload --------------------------------------------------------------------------------------------

  function shadeEpochs(plot, ctx, x) {
    ctx.fillStyle = palette.panel;
    trend.epochs.forEach((epoch, place) => {
      if (place % 2 === 0) return;
      const begin = epoch.begins === null ? plot.scales.x.min : seconds(epoch.begins);
      const end = epoch.ends === null ? plot.scales.x.max : seconds(epoch.ends);
      ctx.fillRect(x(begin), plot.bbox.top, x(end) - x(begin), plot.bbox.height);
    });
  }

  function drawFan(ctx, x, y) {
    const { ahead } = trend;
    if (!ahead?.begins || !ahead.days.length) return;
    const begin = seconds(ahead.begins);
    const column = (probability) => ahead.probabilities.findIndex((each) => Math.abs(each - probability) < 1e-9);
    const at = (place) => x(begin + DAY * ahead.days[place]);
    ctx.fillStyle = palette.accent;
    for (const [low, high, opacity] of [[0.05, 0.95, 0.16], [0.25, 0.75, 0.28]]) {
      const [lower, upper] = [column(low), column(high)];
      if (lower < 0 || upper < 0) continue;
      ctx.globalAlpha = opacity;
      ctx.beginPath();
      ahead.ratio.forEach((row, place) => ctx[place ? "lineTo" : "moveTo"](at(place), y(100 * row[lower])));
      for (let place = ahead.ratio.length - 1; place >= 0; place--) ctx.lineTo(at(place), y(100 * ahead.ratio[place][upper]));
      ctx.fill();
    }
    ctx.globalAlpha = 1;
    ctx.strokeStyle = palette.accent;
    ctx.lineWidth = 1.5 * ratio();
    ctx.beginPath();
    ahead.ratio.forEach((row, place) => ctx[place ? "lineTo" : "moveTo"](at(place), y(100 * row[column(0.5)])));
    ctx.stroke();
  }

  function bars(ctx, x, y, times, intervals, width) {
    ctx.lineWidth = width * ratio();
    intervals.forEach((each, place) => each && line(ctx, x(times[place]), y(each[1]), x(times[place]), y(each[2])));
  }

  const scaled = (intervals) => intervals.map((each) => each && each.map((value) => 100 * value));

  function behindPreload(plot, ctx, x, y) {
    shadeEpochs(plot, ctx, x);
    ctx.strokeStyle = palette.line;
    bars(ctx, x, y, trend.runs.time, scaled(trend.runs.nut), 3);
    ctx.strokeStyle = palette.soft;
    ctx.lineWidth = ratio();
    line(ctx, plot.bbox.left, y(100), plot.bbox.left + plot.bbox.width, y(100));
    drawFan(ctx, x, y);
  }

  function frontPreload(plot, ctx, x, y) {
    const { time, state, stiffness, nut } = trend.runs;
    const many = time.length > MANY;
    const radius = (many ? 2.2 : 3.6) * ratio();
    const floor = plot.bbox.top + plot.bbox.height - 6 * ratio();
    time.forEach((each, place) => {
      const colour = palette[`fill-${state[place]}`] ?? palette.soft;
      ctx.strokeStyle = ctx.fillStyle = colour;
      const interval = stiffness[place];
      ctx.lineWidth = (many ? 0.8 : 1.3) * ratio();
      if (!interval && nut[place]) return below(ctx, x(each), y(100 * nut[place][2]));
      if (!interval) return shape(ctx, state[place], x(each), floor, radius);
      ctx.globalAlpha = many ? 0.5 : 0.9;
      line(ctx, x(each), y(100 * interval[1]), x(each), y(100 * interval[2]));
      ctx.globalAlpha = 1;
      shape(ctx, state[place], x(each), y(100 * interval[0]), radius);
    });
    drawMarks(plot, ctx, x);
  }

  // An upper limit alone: an arrow downwards.
  function below(ctx, x, y) {
    const size = 4 * ratio();
    line(ctx, x - size, y, x + size, y);
    line(ctx, x, y, x, y + 5 * size);
    ctx.beginPath();
    polygon(ctx, [[x - size, y + 4 * size], [x + size, y + 4 * size], [x, y + 6 * size]]);
    ctx.fill();
  }

  function marks() {
    const found = trend.events.map((each) => ({ at: seconds(each.at), text: each.kind, alarm: false }));
    for (const each of trend.alarms) {
      const at = seconds(each.began_at);
      const day = ballscrew.calendar.format(ballscrew.instant(each.began_at));
      found.push({ at, text: `${words.alarm} ${day}`, alarm: true, over: each.ended_at !== null });
    }
    return found.sort((a, b) => a.at - b.at);
  }

  function drawMarks(plot, ctx, x, labelled = true) {
    ctx.font = `${12 * ratio()}px system-ui, sans-serif`;
    ctx.textBaseline = "top";
    const ends = [];
    for (const mark of marks()) {
      const left = x(mark.at);
      if (left < plot.bbox.left || left > plot.bbox.left + plot.bbox.width) continue;
      ctx.strokeStyle = mark.alarm ? palette.alarm : palette.soft;
      ctx.setLineDash(mark.alarm && !mark.over ? [] : [3 * ratio(), 3 * ratio()]);
      ctx.lineWidth = (mark.alarm ? 1.6 : 1) * ratio();
      line(ctx, left, plot.bbox.top, left, plot.bbox.top + plot.bbox.height);
      if (!labelled) continue;
      const wide = ctx.measureText(mark.text).width + 8 * ratio();
      const turned = left + wide > plot.bbox.left + plot.bbox.width;
      const begin = turned ? left - wide : left;
      let row = ends.findIndex((end) => end < begin);
      if (row < 0) row = ends.length;
      ends[row] = begin + wide;
      if (row > 5) continue;
      const top = plot.bbox.top + (4 + 15 * row) * ratio();
      ctx.fillStyle = palette.back;
      ctx.globalAlpha = 0.8;
      ctx.fillRect(begin + 3 * ratio(), top - ratio(), wide - 6 * ratio(), 14 * ratio());
      ctx.globalAlpha = 1;
      ctx.fillStyle = mark.alarm ? palette.alarm : palette.text;
      ctx.fillText(mark.text, begin + 4 * ratio(), top);
    }
    ctx.setLineDash([]);
  }

  // Lines end with their epoch; pixels.
  function betweenEpochs(plot, series, first, last, gaps) {
    const { epoch, time } = trend.runs;
    const found = [...gaps];
    for (let place = Math.max(first, 1); place <= last; place++)
      if (epoch[place] !== epoch[place - 1])
        found.push([time[place - 1], time[place]].map((each) => Math.round(plot.valToPos(each, "x", true))));
    return found.sort((a, b) => a[0] - b[0]);
  }

  function highest() {
    const ends = finite(trend.runs.stiffness.map((each) => each && Math.min(each[2], 1.6)));
    return 108 * Math.max(1.1, most(ends));
  }

  function span() {
    const { time } = trend.runs;
    extend(time[0], time[time.length - 1]);
    const { ahead } = trend;
    if (!ahead?.begins || !ahead.days.length) return;
    const begin = seconds(ahead.begins);
    const reach = Math.max((begin - time[0]) / 2, 60 * DAY);
    extend(begin, begin + Math.min(DAY * ahead.days[ahead.days.length - 1], reach));
  }

  // ---- readout --------------------------------------------------------------------------------------------

  // As interval_words in base/words.py.
  function interval(each) {
    if (!each) return "–";
    const [value, low, high] = each.map((part) => ballscrew.number(100 * part, each[2] - each[1] < 0.02 ? 1 : 0));
    return (each[1] <= 0 ? words.below : words.interval).replace("{value}", value).replace("{low}", low).replace("{high}", high);
  }

  function show(place) {
    const { runs } = trend;
    if (place === null || place === undefined || !runs.run[place]) return;
    const text = [ballscrew.clock.format(new Date(1000 * runs.time[place]))];
    text.push(`${SIGNS[runs.state[place]] ?? SIGNS.unknown} ${words[runs.state[place]] ?? runs.state[place]}`);
    text.push(`${words.stiffness} ${interval(runs.stiffness[place])}`);
    if (runs.nut[place]) text.push(`${words.nut} ${interval(runs.nut[place])}`);
    if (runs.quality[place] && runs.quality[place] !== "good") text.push(`${words.measurement}: ${words[runs.quality[place]] ?? runs.quality[place]}`);
    if (runs.temperature_C[place] !== null) text.push(`${ballscrew.number(runs.temperature_C[place], 1)} °C`);
    element("axis-readout").textContent = text.join(" · ");
    element("axis-run").value = place;
    element("axis-run").setAttribute("aria-valuetext", text.join(", "));
    element("axis-open").href = `/runs/${encodeURIComponent(runs.run[place])}`;
    element("axis-open").hidden = false;
  }

  function moveCursor(place) {
    show(place);
    const plot = plots[0];
    const left = plot.valToPos(trend.runs.time[place], "x");
    plot.setCursor({ left, top: 10 });
  }

  function startReadout() {
    const slider = element("axis-run");
    const last = trend.runs.run.length - 1;
    const newest = Number(slider.value) === Number(slider.max);
    slider.max = last;
    if (newest) show(last);
    if (slider.dataset.started) return;
    slider.dataset.started = "yes";
    slider.addEventListener("input", () => moveCursor(Number(slider.value)));
    slider.addEventListener("keydown", (event) => event.key === "Enter" && opened(trend.runs.run[slider.value]));
    for (const button of document.querySelectorAll(".spans button"))
      button.addEventListener("click", () => {
        const days = Number(button.dataset.days);
        const end = trend.runs.time[trend.runs.time.length - 1];
        zoom(days ? [end - days * DAY, end + 0.25 * days * DAY] : null);
        button.setAttribute("aria-pressed", "true");
      });
  }

  // ---- charts of a run each -------------------------------------------------------------------------------

  const points = (colour) => ({ show: (plot) => plot.data[0].length < MANY, size: 5, stroke: colour, fill: colour });
  const stroke = () => palette.accent;

  function about(values, narrowest) {
    const known = finite(values);
    if (!known.length) return [0, 1];
    const [low, high] = [least(known), most(known)];
    const margin = Math.max(0.08 * (high - low), narrowest);
    return [low - margin, high + margin];
  }

  function tableOf(root, name, rows) {
    const details = root.querySelector(`details[data-table=${name}]`);
    details.rows = rows;
    const fill = () => {
      if (!details.open) return;
      const body = details.querySelector("tbody");
      body.replaceChildren();
      for (const [run, time, ...cells] of details.rows()) {
        const row = body.insertRow();
        const head = document.createElement("th");
        const link = document.createElement("a");
        head.scope = "row";
        head.dataset.value = time;
        link.href = `/runs/${encodeURIComponent(run)}`;
        link.textContent = ballscrew.clock.format(new Date(1000 * time));
        head.append(link);
        row.append(head);
        for (const [value, decimals] of cells) {
          const cell = row.insertCell();
          cell.className = "number";
          cell.dataset.value = value ?? "";
          cell.textContent = ballscrew.number(value, decimals);
        }
      }
    };
    if (!details.dataset.started) details.addEventListener("toggle", () => details.fill());
    details.dataset.started = "yes";
    details.fill = fill;
    fill();
  }

  function drawTrend(root, document_) {
    const isFirst = !trend;
    trend = document_;
    words = JSON.parse(element("axis-charts").dataset.words);
    readPalette();
    span();
    const { run, time, stiffness, temperature_C: temperature } = trend.runs;
    const place = (name) => root.querySelector(`[data-plot=${name}]`);
    const clip = (values) => values.map((value) => (value === null ? null : Math.min(value, HIGHEST)));
    update(place("preload"), run, [time, stiffness.map((each) => each && 100 * each[0])], {
      scale: { range: () => [0, highest()] },
      axis: { values: (plot, splits) => splits.map((each) => `${ballscrew.number(each, 0)} %`) },
      series: [{ paths: () => null, points: { show: false } }],
      behind: behindPreload,
      front: frontPreload,
      hover: (plot) => plot.cursor.left >= 0 && show(plot.cursor.idx),
    });
    const [ramp, odds] = [clip(trend.runs.ramp), clip(trend.runs.odds)];
    update(place("evidence"), run, [time, ramp, odds], {
      scale: { distr: 4, asinh: 1, range: () => [0, 1.15 * Math.min(HIGHEST, Math.max(3, most(finite([...trend.runs.ramp, ...trend.runs.odds]))))] },
      axis: { splits: (plot, axis, low, high) => [0, 1, 3, 10, 30, 100].filter((each) => each <= high), filter: (plot, splits) => splits, values: (plot, splits) => splits.map(String) },
      series: [
        { stroke, width: 1.4, gaps: betweenEpochs, points: points(stroke) },
        { stroke, width: 1.2, gaps: betweenEpochs, dash: [5, 4], points: { ...points(stroke), size: 3 } },
      ],
      behind: (plot, ctx, x) => shadeEpochs(plot, ctx, x),
      front: (plot, ctx, x, y) => {
        ctx.strokeStyle = ctx.fillStyle = palette.alarm;
        ctx.lineWidth = 1.4 * ratio();
        line(ctx, plot.bbox.left, y(1), plot.bbox.left + plot.bbox.width, y(1));
        ctx.font = `${12 * ratio()}px system-ui, sans-serif`;
        ctx.textBaseline = "bottom";
        ctx.fillText(words.limit, plot.bbox.left + 6 * ratio(), y(1) - 2 * ratio());
        drawMarks(plot, ctx, x, false);
      },
    });
    tableOf(root, "evidence", () => run.map((each, row) => [each, time[row], [trend.runs.ramp[row], 2], [trend.runs.odds[row], 2]]));
    const warm = place("temperature");
    warm.closest("figure").hidden = !finite(temperature).length;
    if (finite(temperature).length)
      update(warm, run, [time, temperature], {
        scale: { range: () => about(trend.runs.temperature_C, 1) },
        series: [{ stroke, width: 1, points: points(stroke) }],
      });
    startReadout();
    zoom(view.now);
    const responses = document.querySelector("[data-responses]");
    if (isFirst && responses?.open) loadResponses(responses); // it was opened before
  }

  function drawMechanics(root, document_) {
    readPalette();
    const { run, time, lost_motion_m: lost, coulomb_N: coulomb, viscous_N_s_per_m: viscous, equivalent_mass_kg: mass } = document_;
    const spread = (values) => values.map((each) => each && [each[0], each[0] - 1.96 * (each[1] ?? 0), each[0] + 1.96 * (each[1] ?? 0)]);
    const micro = lost.map((each) => each && each.map((value) => 1e6 * value));
    const shown = { coulomb_N: spread(coulomb), viscous_N_s_per_m: spread(viscous), lost_motion_m: micro };
    for (const [name, intervals] of Object.entries(shown)) {
      const place = root.querySelector(`[data-plot=${name}]`);
      const known = intervals.filter(Boolean);
      place.closest("figure").hidden = !known.length;
      if (!known.length) continue;
      const ends = about(known.flat(), 1e-3 * Math.abs(known[0][0]));
      place.intervals = { time, intervals, ends };
      update(place, run, [time, intervals.map((each) => each && each[0])], {
        scale: { range: () => place.intervals.ends },
        series: [{ stroke, width: 0.8, points: points(stroke) }],
        behind: (plot, ctx, x) => trend && shadeEpochs(plot, ctx, x),
        front: (plot, ctx, x, y) => {
          ctx.strokeStyle = palette.accent;
          ctx.globalAlpha = 0.5;
          bars(ctx, x, y, place.intervals.time, place.intervals.intervals, 1.2);
          ctx.globalAlpha = 1;
          if (trend) drawMarks(plot, ctx, x, false);
        },
      });
    }
    const none = Object.values(shown).every((each) => !each.some(Boolean));
    root.querySelector("[data-none]").hidden = !none;
    root.querySelector("details").hidden = none;
    const first = (each) => (each ? each[0] : null);
    tableOf(root, "mechanics", () => run.map((each, row) => [each, time[row], [first(coulomb[row]), 1], [first(viscous[row]), 0], [first(mass[row]), 1], [first(micro[row]), 2]]));
    if (time.length) extend(time[0], time[time.length - 1]);
    if (view.full) zoom(view.now);
  }

  // ---- map along the axis ---------------------------------------------------------------------------------

  const SEQUENCE = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
  const CHANGE = [[165, 60, 0], [230, 145, 60], null, [100, 165, 215], [25, 85, 150]];

  function mapped(colours, share) {
    const at = Math.min(Math.max(share, 0), 1) * (colours.length - 1);
    const low = Math.min(Math.floor(at), colours.length - 2);
    const parts = colours[low].map((value, place) => Math.round(value + (at - low) * (colours[low + 1][place] - value)));
    return `rgb(${parts.join(",")})`;
  }

  function scaleOf(map) {
    const values = finite(map[map.kind].flat());
    if (map.kind === "frequency_Hz") {
      const low = least(values);
      return { colours: SEQUENCE, low, high: Math.max(low + 0.1, most(values)), text: (value) => `${ballscrew.number(value, 1)} Hz` };
    }
    const size = Math.max(0.02, Math.ceil(200 * most(values.map((value) => Math.abs(value - 1)))) / 200);
    const colours = CHANGE.map((each) => each ?? (ballscrew.isDark() ? [52, 58, 64] : [240, 240, 240]));
    const sign = (value) => `${value > 1 ? "+" : "−"}${ballscrew.number(100 * Math.abs(value - 1), 1)} %`;
    return { colours, low: 1 - size, high: 1 + size, text: sign };
  }

  function edges(values, widest) {
    const found = [];
    values.forEach((value, place) => {
      const before = place ? Math.min((value - values[place - 1]) / 2, widest) : null;
      const after = place < values.length - 1 ? Math.min((values[place + 1] - value) / 2, widest) : null;
      found.push([value - (before ?? after ?? widest), value + (after ?? before ?? widest)]);
    });
    return found;
  }

  // Cells of a map: a column for each time, each with values by row, whose lower and upper ends are given.
  function drawCells(ctx, x, y, { colours, low, high }, time, rows, values) {
    const gaps = time.slice(1).map((each, place) => each - time[place]).sort((a, b) => a - b);
    edges(time, Math.max(gaps[Math.floor(gaps.length / 2)] ?? DAY, DAY / 24)).forEach(([begin, end], column) => {
      const [left, right] = [Math.floor(x(begin)), Math.ceil(x(end))];
      rows.forEach(([bottom, top], row) => {
        const value = values[column]?.[row] ?? null;
        if (value === null) return;
        ctx.fillStyle = mapped(colours, (value - low) / (high - low));
        const [upper, lower] = [Math.floor(y(top)), Math.ceil(y(bottom))];
        ctx.fillRect(left, upper, Math.max(right - left, 1), lower - upper);
      });
    });
  }

  function drawMap(map, ctx, x, y) {
    const rows = edges(map.position_m, Infinity).map((ends) => (Number.isFinite(ends[0]) ? ends : [-0.01, 0.01]).map((end) => 1000 * end));
    drawCells(ctx, x, y, map.scale, map.time, rows, map[map.kind]);
  }

  function drawScale(root, map) {
    const canvas = root.querySelector(".scale canvas");
    const ctx = canvas.getContext("2d");
    for (let place = 0; place < canvas.width; place++) {
      ctx.fillStyle = mapped(map.scale.colours, place / (canvas.width - 1));
      ctx.fillRect(place, 0, 1, canvas.height);
    }
    root.querySelector("[data-low]").textContent = map.scale.text(map.scale.low);
    root.querySelector("[data-high]").textContent = map.scale.text(map.scale.high);
  }

  function drawFrequencies(root, document_) {
    readPalette();
    const place = root.querySelector("[data-plot=frequencies]");
    const choice = () => root.querySelector("input[name=frequency]:checked")?.value ?? "relative";
    // The copy of the page that brought a change has unchecked the choice of this one.
    if (place.map) root.querySelector(`input[value=${place.map.kind}]`).checked = true;
    root.hidden = !document_.position_m.length;
    if (root.hidden) return;
    const map = Object.assign(place.map ?? {}, document_, { kind: choice() });
    map.scale = scaleOf(map);
    drawScale(root, map);
    const stops = edges(map.position_m, Infinity).flat().filter(Number.isFinite);
    const range = stops.length ? [1000 * least(stops), 1000 * most(stops)] : [1000 * map.position_m[0] - 10, 1000 * map.position_m[0] + 10];
    const plot = update(place, map.run, [map.time, map.time.map(() => null)], {
      scale: { range: () => range },
      axis: { values: (each, splits) => splits.map((value) => `${ballscrew.number(value, 0)} mm`), grid: { show: false } },
      dates: { grid: { show: false } },
      reach: Infinity,
      series: [{ paths: () => null, points: { show: false } }],
      behind: (each, ctx, x, y) => drawMap(map, ctx, x, y),
      front: (each, ctx, x) => trend && drawMarks(each, ctx, x, false),
    });
    if (!place.map)
      root.addEventListener("change", () => {
        map.kind = choice();
        root.redraw();
      });
    place.map = map;
    root.redraw = () => {
      map.scale = scaleOf(map);
      drawScale(root, map);
      plot.redraw();
    };
    const head = root.querySelector("details thead tr");
    if (head.cells.length === 1)
      for (const position of map.position_m) {
        const cell = document.createElement("th");
        cell.scope = "col";
        cell.className = "number";
        cell.textContent = `${ballscrew.number(1000 * position, 0)} mm`;
        head.append(cell);
      }
    ballscrew.sortable(root);
    tableOf(root, "frequencies", () => map.run.map((each, row) => [each, map.time[row], ...map.frequency_Hz[row].map((value) => [value, 2])]));
    if (map.time.length) extend(map.time[0], map.time[map.time.length - 1]);
    if (view.full) zoom(view.now);
  }

  // ---- FRF by day and frequency ---------------------------------------------------------------------------

  const cellName = (cell) => `${ballscrew.number(1000 * cell.position_m, 1)} mm ${cell.condition}${cell.motion ? ` (${cell.motion + 1})` : ""}`;

  function offerCells(select, { cells, cell }) {
    if (select.length === cells.length) return;
    select.replaceChildren(...cells.map((each, number) => new Option(cellName(each), number, false, number === cell)));
  }

  function drawNaturalFrequency(map, ctx, x, y) {
    const half = map.standard_uncertainty_Hz.map((value) => 1.96 * (value ?? 0));
    for (const [colour, width] of [[palette.back, 4], [palette.text, 1.6]]) {
      ctx.strokeStyle = colour;
      ctx.lineWidth = width * ratio();
      ctx.beginPath();
      map.natural_frequency_Hz.forEach((value, place) => value !== null && ctx.lineTo(x(map.time[place]), y(value)));
      ctx.stroke();
      ctx.lineWidth = (width - 0.8) * ratio();
      map.natural_frequency_Hz.forEach((value, place) => {
        if (value !== null) line(ctx, x(map.time[place]), y(value - half[place]), x(map.time[place]), y(value + half[place]));
      });
    }
  }

  const LATER = [202, 429, 503, 507]; // reasons that pass

  function drawResponses(root, document_) {
    readPalette();
    const place = root.querySelector("[data-plot=responses]");
    const map = Object.assign((place.map ??= {}), document_);
    offerCells(root.querySelector("select"), map);
    const drawn = map.magnitude_dB.filter(Boolean);
    const parts = [`${drawn.length} ${words.drawn}`, `${map.time.length - map.stored} ${words.blank}`];
    if (map.stored > drawn.length + map.waiting.length + map.refused) parts.push(`${map.stored} ${words.stored}`);
    if (map.refused) parts.push(`${map.refused} ${words.refused}`);
    if (map.waiting.length) parts.push(`${map.waiting.length} ${words.waiting}`);
    root.querySelector("[data-about]").textContent = `${words.runs} ${parts.join("; ")}`;
    place.closest("figure").hidden = !drawn.length;
    if (!drawn.length) return;
    const levels = finite(drawn.flat()).sort((a, b) => a - b);
    const end = (share) => levels[Math.round(share * (levels.length - 1))];
    map.scale = { colours: SEQUENCE, low: end(0.02), high: Math.max(end(0.98), end(0.02) + 1), text: (value) => `${ballscrew.number(value, 0)} dB` };
    drawScale(root, map);
    map.rows = edges(map.frequency_Hz, Infinity);
    update(place, map.run, [map.time, map.natural_frequency_Hz], {
      scale: { range: () => [map.rows[0][0], map.rows[map.rows.length - 1][1]] },
      axis: { values: (each, splits) => splits.map((value) => `${ballscrew.number(value, 0)} Hz`), grid: { show: false } },
      dates: { grid: { show: false } },
      reach: Infinity,
      series: [{ paths: () => null, points: { show: false } }],
      hover: (each) => each.cursor.left >= 0 && show(each.cursor.idx),
      behind: (each, ctx, x, y) => drawCells(ctx, x, y, map.scale, map.time, map.rows, map.magnitude_dB),
      front: (each, ctx, x, y) => {
        drawNaturalFrequency(map, ctx, x, y);
        drawMarks(each, ctx, x, false);
      },
    });
    zoom(view.now);
  }

  async function loadResponses(root) {
    const select = root.querySelector("select");
    const request = (root.request = {});
    const isWanted = () => root.open && root.request === request && trend;
    if (!isWanted()) return;
    const answer = await fetch(`${root.dataset.responses}?cell=${select.value || 0}`);
    const map = await answer.json();
    if (!isWanted()) return;
    if (!answer.ok) {
      root.querySelector("[data-about]").textContent = map.detail;
      return;
    }
    drawResponses(root, map);
    await loadWaiting(root, map, isWanted);
  }

  // Computed run by run while somebody looks at it; only what is not there yet is asked for.
  async function loadWaiting(root, map, isWanted) {
    const lines = map.frequency_Hz;
    const query = new URLSearchParams({ low: lines[0] ?? 1, high: lines.at(-1) ?? 2, ...map.cells[map.cell] });
    while (map.waiting.length) {
      const run = map.waiting.shift();
      const answer = await fetch(`/api/v1/runs/${encodeURIComponent(run)}/magnitude?${query}`);
      const { magnitude_dB: magnitude = null } = await answer.json();
      if (!isWanted()) return;
      if (LATER.includes(answer.status)) {
        if (answer.status === 202) map.waiting.unshift(run);
        else map.waiting.push(run);
        await new Promise((done) => setTimeout(done, 500));
        if (!isWanted()) return;
        continue;
      }
      if (magnitude && !lines.length) return loadResponses(root); // whose frequencies are known now
      map.magnitude_dB[map.run.indexOf(run)] = magnitude;
      if (!magnitude) map.refused++;
      drawResponses(root, map);
    }
  }

  function startResponses() {
    const root = document.querySelector("[data-responses]");
    if (!root) return;
    root.addEventListener("toggle", () => loadResponses(root));
    root.querySelector("select").addEventListener("change", () => loadResponses(root));
  }

  // ---- changes --------------------------------------------------------------------------------------------

  const drawings = { "axis-trend": drawTrend, "axis-mechanics": drawMechanics, "axis-frequencies": drawFrequencies };
  Object.assign(ballscrew.charts, drawings);

  async function refresh() {
    for (const [name, draw] of Object.entries(drawings)) {
      const root = document.querySelector(`[data-chart=${name}]`);
      if (!root?.dataset.drawn) continue;
      const answer = await fetch(root.dataset.source);
      if (answer.ok) draw(root, await answer.json());
    }
    const root = document.querySelector("[data-responses]");
    if (root?.open) loadResponses(root);
  }

  document.addEventListener("DOMContentLoaded", () => {
    startResponses();
    let open = [];
    document.body.addEventListener("htmx:beforeSwap", () => {
      open = [...document.querySelectorAll("#axis > section details[open] > summary")].map((each) => each.textContent);
    });
    document.body.addEventListener("htmx:afterSwap", () => {
      for (const each of document.querySelectorAll("#axis > section details > summary"))
        if (open.includes(each.textContent)) each.parentNode.open = true;
      refresh();
    });
    ballscrew.recolours.push(() => {
      readPalette();
      document.querySelector("[data-chart=axis-frequencies]")?.redraw?.();
      for (const plot of plots) plot.redraw();
    });
  });
})();
