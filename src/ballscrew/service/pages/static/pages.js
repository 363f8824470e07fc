// What all pages do: local times, sortable tables with CSV, the filter of the fleet, changes, and charts.
"use strict";

const ballscrew = (() => {
  const language = document.documentElement.lang;
  const locale = navigator.languages.find((each) => each.startsWith(language)) ?? language;
  const clock = new Intl.DateTimeFormat(locale, { dateStyle: "medium", timeStyle: "short" });
  const calendar = new Intl.DateTimeFormat(locale, { dateStyle: "medium" });
  const dayOfYear = new Intl.DateTimeFormat(locale, { day: "numeric", month: "short" });
  const charts = {};

  // As the command line rounds: half of a step, exactly, to the even digit.
  function round(value, decimals) {
    const [rounded, digits] = [value.toFixed(decimals), value.toFixed(decimals + 30)];
    if (!/50{29}$/.test(digits)) return rounded;
    const below = decimals ? digits.slice(0, -30) : digits.slice(0, -31);
    return "02468".includes(below.at(-1)) ? below : rounded;
  }

  // Negative numbers have a minus sign on pages, and a hyphen in files for computers.
  const number = (value, decimals = 2) =>
    value === null || value === undefined
      ? "–"
      : Number(round(value, decimals)).toLocaleString(language, {
          minimumFractionDigits: decimals,
          maximumFractionDigits: decimals,
        }).replace("-", "−");

  // A time without a zone is in UTC, as on the server.
  const instant = (text) => new Date(/[Tt ]\d\d:?\d\d[^zZ+-]*$/.test(text) ? `${text}Z` : text);

  function localTimes(root) {
    for (const each of root.querySelectorAll("time[datetime]")) {
      const at = instant(each.dateTime);
      if (!Number.isNaN(at.getTime())) {
        const isDay = each.classList.contains("day");
        each.title = each.title || (isDay ? clock.format(at) : each.textContent);
        const day = at.getFullYear() === new Date().getFullYear() ? dayOfYear : calendar;
        each.textContent = (isDay ? day : clock).format(at);
      }
    }
  }

  const valueOf = (row, column) => {
    const cell = row.cells[column];
    return cell.dataset.value !== undefined ? cell.dataset.value : cell.textContent.trim().replace(/^–$/, "");
  };

  function compare(a, b) {
    const [x, y] = [Number(a), Number(b)];
    return Number.isNaN(x) || Number.isNaN(y) ? a.localeCompare(b, language, { numeric: true }) : x - y;
  }

  function sortable(root) {
    for (const table of root.querySelectorAll("table[data-sortable]")) {
      [...table.tHead.rows[0].cells].forEach((cell, column) => {
        if (cell.dataset.fixed !== undefined || cell.querySelector("button")) return;
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = cell.textContent.trim();
        cell.textContent = "";
        cell.append(button);
        button.addEventListener("click", () => sort(table, cell, column));
      });
    }
  }

  function sort(table, cell, column) {
    const ascending = cell.getAttribute("aria-sort") !== "ascending";
    for (const each of table.tHead.rows[0].cells) each.removeAttribute("aria-sort");
    cell.setAttribute("aria-sort", ascending ? "ascending" : "descending");
    const rows = [...table.tBodies[0].rows];
    const isEmpty = (row) => valueOf(row, column) === "";
    const filled = rows.filter((row) => !isEmpty(row));
    filled.sort((a, b) => (ascending ? 1 : -1) * compare(valueOf(a, column), valueOf(b, column)));
    table.tBodies[0].append(...filled, ...rows.filter(isEmpty)); // in both directions
  }

  const field = (text) => {
    // A spreadsheet executes a text that begins so; of another language also after a semicolon, as on the server.
    const inner = text.replace(/([;\t\r\n]"? *)(?=[=+@＝＋－＠-])/g, "$1'");
    const safe = /^ *[=+\-@\t\r\n＝＋－＠]/.test(inner) && Number.isNaN(Number(inner)) ? `'${inner}` : inner;
    return `"${safe.replaceAll('"', '""')}"`;
  };

  // Text of a cell, with times as in its markup: in UTC by ISO 8601.
  function plain(cell) {
    let text = cell.innerText;
    for (const each of cell.querySelectorAll("time")) text = text.replace(each.innerText, each.dateTime);
    return text.trim().replace(/\s+/g, " ").replace(/−(?=\d)/g, "-");
  }

  function csv(table) {
    const lines = [...table.rows]
      .filter((row) => !row.hidden)
      .map((row) => [...row.cells].map((cell) => field(plain(cell))).join(","));
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob(["\ufeff" + lines.join("\r\n") + "\r\n"], { type: "text/csv" }));
    link.download = `${table.dataset.csv}.csv`;
    link.click();
    URL.revokeObjectURL(link.href);
  }

  // On a phone the cells of a row are below each other, each with its head.
  function labelled(root) {
    for (const table of root.querySelectorAll("table.labelled"))
      for (const cell of table.querySelectorAll("tbody td")) cell.dataset.head = table.tHead.rows[0].cells[cell.cellIndex].textContent.trim();
  }

  function exportable(root) {
    for (const table of root.querySelectorAll("table[data-csv]")) {
      if (table.dataset.exportable) continue;
      table.dataset.exportable = "yes";
      const tools = document.createElement("p");
      tools.className = "tools";
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = "CSV";
      button.addEventListener("click", () => csv(table));
      tools.append(button);
      (table.closest(".wide") || table).after(tools);
    }
  }

  function filter() {
    const form = document.querySelector("form[data-filter=fleet]");
    const table = document.querySelector("table.fleet");
    if (!form || !table) return;
    const words = form.search.value.toLocaleLowerCase(language).split(/\s+/).filter(Boolean);
    for (const row of table.tBodies[0].rows) {
      const text = row.dataset.text.toLocaleLowerCase(language);
      const found = words.every((word) => text.includes(word));
      row.hidden = !found || (form.state.value !== "" && row.dataset.state !== form.state.value);
    }
    if (form.group.checked) {
      const rows = [...table.tBodies[0].rows];
      const first = {};
      rows.forEach((row, place) => (first[row.dataset.machine] ??= place));
      rows.sort((a, b) => first[a.dataset.machine] - first[b.dataset.machine]);
      table.tBodies[0].append(...rows);
    }
    const query = new URLSearchParams();
    if (form.search.value) query.set("search", form.search.value);
    if (form.state.value) query.set("state", form.state.value);
    if (form.group.checked) query.set("group", "machine");
    history.replaceState(null, "", query.size ? `?${query}` : location.pathname);
  }

  function startFilter() {
    const form = document.querySelector("form[data-filter=fleet]");
    if (!form) return;
    const query = new URLSearchParams(location.search);
    form.search.value = query.get("search") ?? "";
    form.state.value = query.get("state") ?? "";
    form.group.checked = query.get("group") === "machine";
    form.addEventListener("input", filter);
    form.addEventListener("submit", (event) => event.preventDefault());
    filter();
  }

  // A browser has few connections to a server: a window that is hidden gives its own back.
  function watchChanges() {
    if (!document.querySelector("[data-live]")) return;
    let [source, waiting] = [null, null];
    const announce = () => {
      waiting ??= setTimeout(() => {
        waiting = null;
        htmx.trigger(document.body, "changes");
      }, 1000);
    };
    const open = () => {
      source?.close();
      source = null;
      if (document.hidden) return;
      source = new EventSource("/api/v1/events");
      source.addEventListener("change", announce);
    };
    document.addEventListener("visibilitychange", () => {
      open();
      if (!document.hidden) announce();
    });
    window.addEventListener("pagehide", () => source?.close());
    open();
  }

  // What the server expects from its own pages alone.
  const formToken = () => document.querySelector("meta[name=csrf]")?.content;
  const ownHeaders = () => (formToken() ? { "X-CSRF-Token": formToken() } : {});

  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

  // Data of an address; while the server says when to ask again, it is asked until they are there.
  async function fetched(address, waiting, signal) {
    for (;;) {
      const answer = await fetch(address, { signal });
      const data = await answer.json();
      if (answer.status === 200) return data;
      const pause = Number(answer.headers.get("Retry-After"));
      if (!pause) throw new Error(data.detail);
      waiting(data.detail);
      await new Promise((done) => setTimeout(done, 1000 * pause));
    }
  }

  // A plot is as wide as its place, and in print as A4 between its margins.
  const PAPER = 700; // CSS pixels
  const LOWER = 0.8; // height on paper relative to that on a screen
  const scheme = matchMedia("(prefers-color-scheme: dark)");
  const fits = [];
  const recolours = []; // of scripts of pages, called when the colours have changed
  let isPrinting = false;

  const isDark = () => scheme.matches && !isPrinting;
  const recolour = () => recolours.forEach((each) => each());

  const widthOf = (place) => (isPrinting ? PAPER : Math.max(place.clientWidth, 200));

  function fit(plot, place) {
    const { height: high } = plot;
    const resize = () => {
      const [width, height] = [widthOf(place), isPrinting ? LOWER * high : high];
      if (place.clientWidth && (plot.width !== width || plot.height !== height)) plot.setSize({ width, height });
    };
    new ResizeObserver(resize).observe(place);
    fits.push(resize);
  }

  function print(begins) {
    isPrinting = begins;
    document.documentElement.classList.toggle("paper", begins);
    recolour();
    for (const resize of fits) resize();
  }

  async function drawChart(place) {
    const { chart, source } = place.dataset;
    const note = document.createElement("p");
    note.className = "message";
    note.setAttribute("role", "status");
    const wait = (text) => {
      note.textContent = text;
      place.prepend(note);
    };
    try {
      const data = source ? await fetched(source, wait) : null;
      note.remove();
      await charts[chart](place, data, wait);
      note.remove();
    } catch (error) {
      place.textContent = error.message;
      place.classList.add("message");
    }
    place.dataset.drawn = "done";
  }

  function drawCharts(root) {
    for (const place of root.querySelectorAll("[data-chart]")) {
      if (place.dataset.drawn) continue;
      place.dataset.drawn = "yes";
      drawChart(place);
    }
  }

  // A script may have changed the query since the page was made.
  function switchLanguage(event) {
    const link = event.target.closest("a[hreflang]");
    if (!link) return;
    const query = new URLSearchParams(location.search);
    query.set("lang", link.hreflang);
    link.search = query;
  }

  function prepare(root) {
    localTimes(root);
    sortable(root);
    labelled(root);
    exportable(root);
    filter();
    drawCharts(root);
  }

  function stateZone() {
    const place = document.getElementById("page-zone");
    const { timeZone: zone } = clock.resolvedOptions();
    if (!/^(Etc\/)?(UTC|GMT)$/.test(zone)) place.textContent = place.dataset.local.replace("{zone}", zone);
  }

  function start() {
    startFilter();
    stateZone();
    prepare(document);
    watchChanges();
    scheme.addEventListener("change", recolour);
    window.addEventListener("beforeprint", () => print(true));
    window.addEventListener("afterprint", () => print(false));
    document.addEventListener("click", switchLanguage);
    document.body.addEventListener("htmx:configRequest", ({ detail }) => Object.assign(detail.headers, ownHeaders()));
    document.body.addEventListener("htmx:afterSwap", (event) => prepare(event.target));
  }

  // Scripts of pages, which are deferred too, add their charts before this runs.
  document.addEventListener("DOMContentLoaded", start);
  return { charts, colour, number, clock, calendar, instant, language, sortable, fetched, widthOf, fit, isDark, recolours, ownHeaders };
})();
