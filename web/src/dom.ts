// Creates elements. Text is always inserted as text: nothing here parses HTML.

/** Attributes of an element: attributes, `class`, `on…` listeners, `data-…`, and properties such as `value`. */
export type Attributes = Record<string, string | number | boolean | null | undefined | ((event: never) => void)>;
export type Child = Node | string | number | null | undefined | false;

/** An HTML element with its attributes and children. */
export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  return build(document.createElement(tag), attributes, children);
}

/** An SVG element with its attributes and children. */
export function s<K extends keyof SVGElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: Child[]
): SVGElementTagNameMap[K] {
  return build(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);
}

/** Sets attributes of an element; `null` and `false` remove them. */
export function set<E extends Element>(element: E, attributes: Attributes): E {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name.slice(2), value as EventListener);
    else if (PROPERTIES.has(name) && name in element) (element as unknown as Record<string, unknown>)[name] = value ?? "";
    else if (value === null || value === undefined || value === false) element.removeAttribute(name);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  return element;
}

/** Replaces the children of an element. */
export function put<E extends Element>(element: E, ...children: Child[]): E {
  element.replaceChildren(...(children.filter((c) => c !== null && c !== undefined && c !== false).map(node) as Node[]));
  return element;
}

let idCount = 0;

/** An id that is unique in the page. */
export function uniqueId(stem: string): string {
  idCount += 1;
  return `${stem}-${idCount}`;
}

/** Names that must be set as properties, because the attribute only gives the initial value. */
const PROPERTIES = new Set(["value", "checked", "disabled", "hidden", "selected", "open"]);

function build<E extends Element>(element: E, attributes: Attributes, children: Child[]): E {
  return put(set(element, attributes), ...children);
}

function node(child: Child): Node {
  return child instanceof Node ? child : document.createTextNode(String(child));
}
