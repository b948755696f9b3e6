// Small parts of pages: elements, tables, and places in a view.
// a point with all its coordinates in a view: two of them, or one over time
export const seen = (view, point, time) => (view.coordinates ? view.coordinates.map((k) => point[k]) : [time, point[0]]);

export function html(name, attributes, children) {
  const made = document.createElement(name);
  Object.assign(made, attributes);
  made.append(...(children || []));
  return made;
}

export function table(names, rows, differing) {
  const head = html("tr", {}, ["", ...names].map((text) => html("th", { textContent: text, scope: "col" })));
  const body = rows.map(({ label, cells, differ }) => html("tr", { className: differ && differing ? "differ" : "" },
    [html("th", { textContent: label, scope: "row" }), ...cells.map((text) => html("td", { textContent: text }))]));
  return html("div", { className: "wide" }, [html("table", {}, [html("thead", {}, [head]), html("tbody", {}, body)])]);
}
