// The interface of a view: one file in views/ and one row in views.ts.

/** Context of an open view. */
export interface Context {
  /** Path segments of the address after the view's id: `["job-3"]` for `#/jobs/job-3`. */
  rest: string[];
  /** Query parameters in the address after `#`. */
  query: URLSearchParams;
  /** Aborts when the view is closed: pass it to `fetch`, `follow` and `addEventListener`. */
  signal: AbortSignal;
  /** Displays an error above the view; `null` removes it. Aborts are ignored. */
  fail: (error: unknown) => void;
  /** Announces a text to screen readers, politely. */
  say: (text: string) => void;
}

/** A view of the page. */
export interface View {
  /** Id in the address: `#/play`. */
  id: string;
  /** Title in the navigation, and the heading of the page. */
  title: string;
  /** One sentence under the heading. */
  about: string;
  /** Fills `place`; may continue until `context.signal` aborts. */
  open: (place: HTMLElement, context: Context) => void | Promise<void>;
}

/** Views with one purpose, side by side in the navigation. */
export interface ViewGroup {
  title: string;
  views: readonly View[];
}

/** The address of a view: `link("jobs", "job-3")` is `#/jobs/job-3`. */
export function link(view: string, rest: string[] = [], query: Record<string, string> = {}): string {
  const parts = [view, ...rest].map(encodeURIComponent).join("/");
  const search = new URLSearchParams(query).toString();
  return `#/${parts}${search ? `?${search}` : ""}`;
}

/** Parses an address. */
export function parseAddress(hash: string): { view: string; rest: string[]; query: URLSearchParams } {
  const [path = "", search = ""] = hash.replace(/^#\/?/, "").split("?", 2);
  const [view = "", ...rest] = path.split("/").filter(Boolean).map(decode);
  return { view, rest, query: new URLSearchParams(search) };
}

function decode(text: string): string {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}
