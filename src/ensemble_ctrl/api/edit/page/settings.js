// Fields of the problem file beside its map, made from the JSON Schema; each with its unit and what it means.
const ELSEWHERE = ["version", "name", "regions", "obstacles", "task", "ignore", "sweep"]; // on the map, or in the text
const DEEP = 5;

export class Settings {
  constructor(app, element) { this.app = app; this.element = element; this.open = new Set(["fleet", "horizon", "fleet.parameters", "fleet.input_bounds"]); }
  describe(schema) { this.schema = schema; this.show(this.app.state, true); }
  show(state, force) {
    if (!state || !this.schema || this.element.hidden) return;
    const focused = this.element.contains(document.activeElement) && document.activeElement.dataset.path;
    if (!force && state.text === this.text) return;
    this.text = state.text;
    const data = state.map.data || {};
    const top = this.schema.properties;
    const title = document.createElement("p");
    title.className = "note";
    title.textContent = "An empty field is left out of the file: its default, shown in grey, holds then.";
    const fields = ["name"].map((key) => this.row(key, top[key], data[key], [key], 0));
    const sections = Object.keys(top).filter((key) => !ELSEWHERE.includes(key)).map((key) => this.section(key, top[key], data[key], [key], 0));
    this.element.replaceChildren(title, ...fields, ...sections);
    if (focused) this.element.querySelector(`[data-path="${CSS.escape(focused)}"]`)?.focus();
  }
  // a schema without references and without null, as far as the data says which of several it is
  plain(schema, value) {
    let found = schema;
    for (let k = 0; k < 8; k++) {
      if (found.$ref) {
        const named = this.schema.$defs[found.$ref.split("/").pop()];
        found = { ...named, description: found.description || named.description, default: found.default };
        continue;
      }
      const several = (found.anyOf || found.oneOf || []).filter((one) => one.type !== "null");
      if (!several.length) break;
      if (several.length > 1 && several.every((one) => !one.$ref)) {
        const flat = several.flatMap((one) => one.anyOf || [one]);
        const section = flat.find((one) => one.type === "object" && one.properties);
        if (section && value && typeof value === "object" && !Array.isArray(value)) { found = { ...section, description: found.description }; continue; }
        return { ...found, several: flat };
      }
      const kept = { description: found.description, default: found.default };
      const chosen = several.length === 1 ? several[0] : several.find((one) => this.fits(one, value)) || several[0];
      found = { ...chosen, ...Object.fromEntries(Object.entries(kept).filter(([, v]) => v !== undefined)) };
    }
    return found;
  }
  fits(schema, value) {
    const own = schema.$ref ? this.schema.$defs[schema.$ref.split("/").pop()] : schema;
    if (!own.properties || !value || typeof value !== "object") return false;
    const model = own.title === "FleetSection" ? ["unicycle", "bicycle"].includes(value.model) : true;
    return model && Object.keys(value).every((key) => key in own.properties);
  }
  section(key, schema, value, path, depth) {
    const own = this.plain(schema, value);
    const name = path.join(".");
    const details = document.createElement("details"), summary = document.createElement("summary");
    summary.textContent = key;
    summary.title = own.description || "";
    if (value === undefined) summary.className = "absent";
    details.append(summary);
    details.open = this.open.has(name);
    const fill = () => {
      if (details.dataset.full) return;
      details.dataset.full = "yes";
      if (own.description) details.append(described(own.description));
      const known = own.properties || {};
      for (const [inner, one] of Object.entries(known)) details.append(this.row(inner, one, value?.[inner], [...path, inner], depth + 1));
      const extra = own.additionalProperties;
      if (extra && typeof extra === "object" || extra === true) {
        for (const inner of Object.keys(value || {}).filter((k) => !(k in known))) {
          details.append(this.row(inner, extra === true ? {} : extra, value[inner], [...path, inner], depth + 1));
        }
      }
    };
    if (details.open) fill();
    details.ontoggle = () => {
      this.open[details.open ? "add" : "delete"](name);
      if (details.open) fill();
    };
    return details;
  }
  row(key, schema, value, path, depth) {
    const own = this.plain(schema, value);
    const section = own.type === "object" && (own.properties || (own.additionalProperties && value));
    if (section && depth < DEEP) return this.section(key, schema, value, path, depth);
    const label = document.createElement("div");
    label.className = "row";
    const name = document.createElement("label");
    name.textContent = key;
    label.append(name);
    const inputs = this.inputs(own, value, path);
    inputs[0].id = `field-${path.join("-")}`;
    name.htmlFor = inputs[0].id;
    const box = document.createElement("span");
    box.className = "inputs";
    box.append(...inputs);
    const unit = unitOf(own);
    if (unit) {
      const shown = document.createElement("span");
      shown.className = "unit";
      shown.textContent = unit;
      box.append(shown);
    }
    label.append(box);
    if (own.description) label.append(described(own.description));
    return label;
  }
  inputs(own, value, path) {
    const put = (text) => this.app.edit(text === "" ? (value === undefined ? [] : [{ do: "remove", path }]) : [{ do: "text", path, value: text }]);
    if (own.type === "boolean") {
      const choice = select(["", "true", "false"], value === undefined ? "" : String(value), own.default);
      choice.onchange = () => put(choice.value);
      return [tagged(choice, path)];
    }
    if (own.enum && (value === undefined || own.enum.includes(value))) {
      const choice = select(["", ...own.enum], value ?? "", own.default);
      choice.onchange = () => put(choice.value);
      return [tagged(choice, path)];
    }
    const pair = own.prefixItems || (own.several || []).find((one) => one.prefixItems)?.prefixItems;
    if (pair && (value === undefined || (Array.isArray(value) && value.length === pair.length))) {
      const fields = pair.map((_, k) => input(value?.[k], own.default?.[k], [...path, k]));
      for (const field of fields) {
        field.onchange = () => {
          const texts = fields.map((one) => one.value.trim());
          if (texts.every((text) => text === "")) put("");
          else if (texts.every((text) => text !== "")) put(`[${texts.join(", ")}]`);
        };
      }
      return fields;
    }
    const field = input(value, own.default, path);
    field.onchange = () => put(field.value.trim());
    return [field];
  }
}

function tagged(element, path) { element.dataset.path = path.join("."); return element; }
function input(value, fallback, path) {
  const element = document.createElement("input");
  element.value = value === undefined ? "" : shown(value);
  element.placeholder = fallback === undefined || fallback === null ? "" : shown(fallback);
  return tagged(element, path);
}
function shown(value) {
  if (Array.isArray(value)) return `[${value.map(shown).join(", ")}]`;
  if (value && typeof value === "object") return `{${Object.entries(value).map(([k, v]) => `${k}: ${shown(v)}`).join(", ")}}`;
  if (typeof value === "string" && /[,:#[\]{}"']/.test(value)) return JSON.stringify(value);
  return String(value);
}
function select(options, value, fallback) {
  const element = document.createElement("select");
  for (const option of options) {
    const text = option === "" ? `(${fallback === undefined ? "default" : shown(fallback)})` : String(option);
    element.append(new Option(text, option, false, String(option) === String(value)));
  }
  return element;
}
function described(text) {
  const element = document.createElement("small");
  text.split("`").forEach((part, i) => {
    const piece = i % 2 ? document.createElement("code") : "";
    if (piece) piece.textContent = part;
    element.append(piece || part);
  });
  return element;
}
// the unit of a field without one typed, from the texts that its schema allows
function unitOf(schema) {
  const found = JSON.stringify(schema).match(/"pattern":"[^"]*"/);
  if (!found) return "";
  const units = [...found[0].matchAll(/\((m|s|rad|deg)\|/g)].map((match) => match[1]);
  return units.slice(0, 2).join("/");
}
