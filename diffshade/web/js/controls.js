// A slider and a number for every coefficient.

const STEPS = 1000;
const COLOURS = ["ambient", "ka", "kd", "od", "os", "ks", "intensity"];  // what a swatch shows
const COMPONENTS = { channels: ["R", "G", "B"], position: ["x", "y", "z"], direction: ["x", "y", "z"] };

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

// Where on its slider a value lies, from 0 to STEPS, and back, to three digits.
function toStep({ range: [low, high], log }, value) {
  const part = log ? Math.log(Math.max(value, low) / low) / Math.log(high / low) : (value - low) / (high - low);
  return Math.round(STEPS * Math.min(Math.max(part, 0), 1));
}

function fromStep({ range: [low, high], log }, step) {
  const part = step / STEPS;
  return Number((log ? low * (high / low) ** part : low + (high - low) * part).toPrecision(3));
}

class Row {
  constructor(one, attempt) {
    this.one = one;
    this.attempt = attempt;
    this.swatch = element("span", { class: "swatch", "aria-hidden": "true" });
    this.inputs = [];
    this.components = element("div");
    const head = element("div", { class: "head" }, element("span", {}, this.swatch, one.words));
    if (one.kind === "channels") {
      this.channels = element("button", { type: "button", class: "small", onclick: () => this.divide() });
      head.append(this.channels);
    }
    this.swatch.hidden = !COLOURS.includes(one.name.split(".").pop());
    this.node = element("div", { class: "row" }, head, this.components);
  }

  // One number for all channels, or one each.
  divide() {
    const numbers = values.get(this.one.name);
    const mean = Number((numbers.reduce((a, b) => a + b) / numbers.length).toPrecision(4));
    this.put(numbers.length === 1 ? [numbers[0], numbers[0], numbers[0]] : [mean]);
  }

  put(numbers) {
    this.attempt(() => set({ [this.one.name]: numbers }));
  }

  change(k, value) {
    const numbers = get(this.one.name);
    numbers[k] = value;
    this.put(numbers);
  }

  build(count) {
    const names = count > 1 ? COMPONENTS[this.one.kind] : [""];
    this.inputs = names.map((name, k) => {
      const label = `${this.one.group}: ${this.one.words}${name && `, ${name}`}`;
      const slider = element("input", {
        type: "range", min: 0, max: STEPS, step: 1, "aria-label": label,
        oninput: () => this.change(k, fromStep(this.one, Number(slider.value))),
      });
      const number = element("input", {
        type: "number", step: "any", "aria-label": `${label}, as a number`,
        onchange: () => this.change(k, number.value.trim() ? Number(number.value) : NaN),
      });
      return { slider, number };
    });
    this.components.replaceChildren(...this.inputs.map(({ slider, number }, k) => {
      const name = names[k] ? [element("span", { class: "quiet", "aria-hidden": "true" }, names[k])] : [];
      return element("div", { class: `component${names[k] ? "" : " alone"}` }, ...name, slider, number);
    }));
  }

  refresh() {
    const numbers = values.get(this.one.name);
    if (this.inputs.length !== numbers.length) this.build(numbers.length);
    numbers.forEach((value, k) => {
      const { slider, number } = this.inputs[k];
      if (fromStep(this.one, Number(slider.value)) !== value) slider.value = toStep(this.one, value);
      slider.setAttribute("aria-valuetext", `${value}`);
      number.value = Number(value.toPrecision(6));
    });
    if (this.channels) this.channels.textContent = numbers.length > 1 ? "one for all" : "per channel";
    const [r, g, b] = numbers.length > 1 ? numbers : [numbers[0], numbers[0], numbers[0]];
    this.swatch.style.background = `color(srgb-linear ${r} ${g} ${b})`;
  }
}

// The rows, group by group, as elements of a form; returns what brings them up to date.
function controls(form, attempt) {
  const rows = [...parameters.values()].map((one) => new Row(one, attempt));
  for (const group of new Set(rows.map((row) => row.one.group))) {
    const own = rows.filter((row) => row.one.group === group);
    form.append(element("fieldset", {}, element("legend", {}, group), ...own.map((row) => row.node)));
  }
  return () => rows.forEach((row) => row.refresh());
}
