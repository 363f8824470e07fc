// Pages of actions: forms whose content was refused, local times that are entered, texts from files, uploads.
"use strict";

(() => {
  // A form that was refused comes back with its sentence: htmx shows it although the status is no success.
  document.addEventListener("htmx:beforeSwap", (event) => {
    const { xhr } = event.detail;
    if (xhr.status >= 400 && (xhr.getResponseHeader("Content-Type") ?? "").startsWith("text/html")) {
      event.detail.shouldSwap = true;
      event.detail.isError = false;
    }
  });

  // What a person is entering is not replaced by a change elsewhere.
  document.addEventListener("htmx:beforeRequest", (event) => {
    const { elt } = event.detail;
    if (elt.id === "alarms" && elt.querySelector("details[open]")) event.preventDefault();
  });

  document.addEventListener("htmx:afterSettle", (event) => {
    const section = document.getElementById(event.detail.target.id) ?? document;
    prepare(section);
    const message = section.querySelector(".message, .preview");
    if (message && event.detail.requestConfig?.verb === "post") {
      message.tabIndex = -1;
      message.focus();
    }
  });

  const pad = (value) => String(value).padStart(2, "0");

  function offsetOf(text) {
    const minutes = Math.round(-new Date(text).getTimezoneOffset());
    return `${minutes < 0 ? "-" : "+"}${pad(Math.floor(Math.abs(minutes) / 60))}:${pad(Math.abs(minutes) % 60)}`;
  }

  function localTime(at) {
    const day = [at.getFullYear(), pad(at.getMonth() + 1), pad(at.getDate())].join("-");
    return `${day}T${pad(at.getHours())}:${pad(at.getMinutes())}`;
  }

  function enterLocalTimes(root) {
    for (const field of root.querySelectorAll("input[name=at]")) {
      const label = field.closest("label").querySelector("[data-zone]");
      label.textContent = label.dataset.zone;
      let zone = field.form.querySelector("input[name=offset]");
      if (!zone) {
        zone = document.createElement("input");
        zone.type = "hidden";
        zone.name = "offset";
        field.form.append(zone);
      }
      const update = () => (zone.value = field.value ? offsetOf(field.value) : "");
      field.addEventListener("input", update);
      if (!field.value) field.value = localTime(new Date());
      update();
    }
    for (const option of root.querySelectorAll("option[data-time]")) {
      const at = ballscrew.instant(option.dataset.time);
      if (Number.isNaN(at.getTime())) continue;
      const [, ...rest] = option.textContent.split(" · ");
      option.textContent = [ballscrew.clock.format(at), ...rest].join(" · ");
      option.removeAttribute("data-time");
    }
  }

  function readFiles(root) {
    for (const chooser of root.querySelectorAll("input[data-read-into]")) {
      chooser.hidden = false;
      chooser.addEventListener("change", async () => {
        const [file] = chooser.files;
        if (!file) return;
        const area = document.getElementById(chooser.dataset.readInto);
        area.value = file.size <= 1 << 20 ? await file.text() : "";
      });
    }
  }

  const hex = (buffer) => [...new Uint8Array(buffer)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  const digest = async (buffer) => hex(await crypto.subtle.digest("SHA-256", buffer));
  const pause = (seconds) => new Promise((resolve) => setTimeout(resolve, 1000 * seconds));

  const sentenceOf = async (answer) => {
    try {
      return (await answer.json()).detail;
    } catch {
      return `${answer.status} ${answer.statusText}`;
    }
  };

  function sendFile(address, file, progress, words) {
    return new Promise((resolve, reject) => {
      const request = new XMLHttpRequest();
      request.open("PUT", address);
      for (const [name, value] of Object.entries(ballscrew.ownHeaders())) request.setRequestHeader(name, value);
      request.upload.addEventListener("progress", (event) => (progress.value = event.loaded / Math.max(1, file.size)));
      request.addEventListener("error", () => reject(new Error(words.connection)));
      request.addEventListener("load", () => {
        if (request.status < 300) return resolve();
        try {
          reject(new Error(JSON.parse(request.responseText).detail));
        } catch {
          reject(new Error(words.connection));
        }
      });
      request.send(file);
    });
  }

  // Names and hashes by which a run is stated.
  const quoted = (text) => JSON.stringify(text).replaceAll("\u007f", "\\u007f");
  const isToml = (name) => name.toLowerCase().endsWith(".toml");
  // Units that a person may write, as RUN.toml has them; the first is that of a bare number.
  const MASSES = { "": "kg", kg: "kg", g: "g", t: "t", lb: "lb", lbs: "lb" };
  const TEMPERATURES = { "": "degC", "°c": "degC", c: "degC", degc: "degC", "°f": "degF", f: "degF", degf: "degF", k: "kelvin" };

  // A number with a unit as RUN.toml has it; null for another text, or where a comma or point may divide thousands.
  function quantity(text, units) {
    const found = /^([+-]?(?:\d+[.,]?\d*|[.,]\d+))\s*(\D*)$/.exec(text.trim());
    if (!found || /^[+-]?[1-9]\d{0,2}[.,]\d{3}$/.test(found[1])) return null;
    const unit = found[2].toLowerCase();
    return Object.hasOwn(units, unit) ? `${Number(found[1].replace(",", "."))} ${units[unit]}` : null;
  }

  function runToml(form, files, words) {
    const load = quantity(form.load.value, MASSES);
    if (load === null || load.startsWith("-")) throw new Error(words.load);
    if (!form.measured_at.value) throw new Error(words.time);
    const lines = ['channels = "channels.toml"', `load = "${load}"`];
    lines.push(`measured_at = ${new Date(form.measured_at.value).toISOString()}`);
    if (form.temperature.value.trim()) {
      const temperature = quantity(form.temperature.value, TEMPERATURES);
      if (temperature === null) throw new Error(words.temperature);
      lines.push(`temperature = "${temperature}"`);
    }
    const names = files.map((file) => file.name);
    for (const kind of ["axis", "plan"]) if (names.includes(`${kind}.toml`)) lines.push(`${kind} = "${kind}.toml"`);
    lines.push(`files = [${names.filter((name) => !isToml(name)).map(quoted).join(", ")}]`);
    return `${lines.join("\n")}\n`;
  }

  async function statedRun(files) {
    for (const file of files) {
      if (!isToml(file.name) || file.size > 1 << 20) continue;
      const text = await file.text();
      if (/^\s*files\s*=/m.test(text)) return { file, text, hasTime: /^\s*measured_at\s*=/m.test(text) };
    }
    return null;
  }

  function element(name, text, className) {
    const found = document.createElement(name);
    found.textContent = text ?? "";
    if (className) found.className = className;
    return found;
  }

  class UploadForm {
    constructor(form, words) {
      Object.assign(this, { form, words, files: [] });
      this.list = form.querySelector("[data-files]");
      this.problem = form.querySelector("[data-problem]");
      this.result = form.querySelector("[data-result]");
      const drop = form.querySelector("[data-drop]");
      form.files.addEventListener("change", () => this.choose([...form.files.files]));
      for (const kind of ["dragenter", "dragover"]) {
        drop.addEventListener(kind, (event) => {
          event.preventDefault();
          drop.classList.add("over");
        });
      }
      for (const kind of ["dragleave", "drop"]) drop.addEventListener(kind, () => drop.classList.remove("over"));
      drop.addEventListener("drop", (event) => {
        event.preventDefault();
        this.choose([...event.dataTransfer.files]);
      });
      form.addEventListener("submit", (event) => {
        event.preventDefault();
        this.send();
      });
    }

    async choose(files) {
      this.files = files;
      this.list.replaceChildren();
      this.result.replaceChildren();
      this.problem.hidden = true;
      for (const file of files) {
        const row = element("li", `${file.name} `);
        row.append(element("small", `${ballscrew.number(file.size / 1e6, 2)} MB `), element("span"));
        this.list.append(row);
      }
      const stated = await statedRun(files);
      for (const each of this.form.querySelectorAll("[data-without-toml]")) each.hidden = stated !== null;
      this.form.measured_at.closest("label").hidden = stated !== null && stated.hasTime;
    }

    state(place, text) {
      this.list.children[place].lastElementChild.textContent = text;
    }

    async send() {
      const button = this.form.querySelector("button");
      this.problem.hidden = true;
      this.result.replaceChildren();
      button.disabled = true;
      try {
        await this.sendRun();
      } catch (error) {
        this.result.replaceChildren();
        this.problem.textContent = error.message;
        this.problem.hidden = false;
      }
      button.disabled = false;
    }

    async sendRun() {
      const { form, words, files } = this;
      if (!crypto.subtle) throw new Error(words.secure);
      if (!files.length) throw new Error(words.none);
      const stated = await statedRun(files);
      const others = files.filter((file) => file !== stated?.file);
      const text = stated?.text ?? runToml(form, others, words);
      if (!others.some((file) => !isToml(file.name))) throw new Error(words.none);
      if (/[\u0000-\u001f\u007f]/.test(form.key.value)) throw new Error(words.key);
      const sent = [];
      for (const file of others) sent.push({ name: file.name, sha256: await this.hash(file) });
      let measuredAt = null; // in the text, or else from the form
      if (stated && !stated.hasTime && form.measured_at.value) measuredAt = new Date(form.measured_at.value).toISOString();
      const content = new TextEncoder().encode(JSON.stringify([text, sent, measuredAt]));
      const key = form.key.value.trim() || `web-${(await digest(content)).slice(0, 16)}`;
      const base = `/api/v1/axes/${encodeURIComponent(form.dataset.axis)}/runs/${encodeURIComponent(key)}`;
      for (const [index, file] of others.entries()) await this.store(base, file, sent[index].sha256);
      const answer = await this.fetch(`${base}/complete`, {
        method: "POST",
        headers: { "Content-Type": "application/json", ...ballscrew.ownHeaders() },
        body: JSON.stringify({ files: sent, run_toml: text, measured_at: measuredAt }),
      });
      if (!answer.ok) throw new Error(await sentenceOf(answer));
      await this.follow((await answer.json()).id, answer.status === 200);
    }

    async fetch(address, options) {
      try {
        return await fetch(address, options);
      } catch {
        throw new Error(this.words.connection);
      }
    }

    async hash(file) {
      const place = this.files.indexOf(file);
      this.state(place, this.words.hash);
      try {
        return await digest(await file.arrayBuffer());
      } catch (error) {
        throw new Error(`${this.words.large} ${file.name} (${error.message})`);
      }
    }

    async store(base, file, sha256) {
      const { words } = this;
      const place = this.files.indexOf(file);
      const address = `${base}/files/${sha256}`;
      const known = await this.fetch(address, { method: "HEAD" });
      if (known.status === 200) return this.state(place, words.known);
      this.state(place, `${words.send} `);
      const progress = document.createElement("progress");
      progress.value = 0;
      progress.setAttribute("aria-label", file.name);
      this.list.children[place].lastElementChild.append(progress);
      await sendFile(address, file, progress, words);
      this.state(place, words.stored);
    }

    async follow(id, isKnown) {
      const { words, result } = this;
      const waiting = element("p", words.queued, "message");
      result.replaceChildren(waiting);
      for (;;) {
        const answer = await this.fetch(`/api/v1/runs/${id}`);
        if (!answer.ok) throw new Error(await sentenceOf(answer));
        const document = await answer.json();
        const sent = document.sent.at(-1);
        if (!sent || sent.status !== "queued") return this.show(document, sent, isKnown);
        await pause(2);
      }
    }

    show(document, sent, isKnown) {
      const { words, result } = this;
      const quality = document.run?.quality;
      if (!quality) throw new Error(`${words.refused} ${sent?.error ?? ""}`);
      const verdict = quality.verdict;
      const line = element("p", isKnown ? `${words.again} ` : "", "message done");
      line.append(element("span", `${words.done} `), element("b", words[verdict] ?? verdict));
      const link = element("a", words.show);
      link.href = `/runs/${encodeURIComponent(sent?.result ?? document.run.id)}`;
      line.append(" · ", link);
      result.replaceChildren(line);
      const reasons = [...quality.reasons];
      if (!document.run.run.measured_at) reasons.push(words.time);
      if (reasons.length) {
        const list = element("ul");
        for (const reason of reasons) list.append(element("li", reason));
        result.append(list);
      }
    }
  }

  function prepare(root) {
    enterLocalTimes(root);
    readFiles(root);
    for (const form of root.querySelectorAll("form.upload")) {
      new UploadForm(form, JSON.parse(document.querySelector("[data-words]").dataset.words));
    }
  }

  document.addEventListener("DOMContentLoaded", () => prepare(document));
})();
