// What a view is: one file in views/ and one row in views.ts.

/** A view that is open, in the place the frame gave it. */
export interface Context {
  /** The rest of the address after the view's id, without slashes: `#/jobs/job-3` gives `["job-3"]`. */
  rest: string[];
  /** What stands behind `?` in the address after `#`. */
  query: URLSearchParams;
  /** Aborts when the view is left: give it to `fetch`, `follow` and `addEventListener`. */
  signal: AbortSignal;
  /** Shows an error above the view, in the server's words; `null` takes it away. An abort is no error. */
  fail: (error: unknown) => void;
  /** Says something to screen readers, politely. */
  say: (text: string) => void;
}

/** A view of the page. */
export interface View {
  /** In the address: `#/play`. */
  id: string;
  /** In the navigation, and the page's heading. */
  title: string;
  /** One sentence under the heading. */
  about: string;
  /** Fills `place`; may go on by itself until `context.signal` aborts. */
  open: (place: HTMLElement, context: Context) => void | Promise<void>;
}

/** The address of a view: `link("jobs", "job-3")` is `#/jobs/job-3`. */
export function link(view: string, rest: string[] = [], query: Record<string, string> = {}): string {
  const parts = [view, ...rest].map(encodeURIComponent).join("/");
  const search = new URLSearchParams(query).toString();
  return `#/${parts}${search ? `?${search}` : ""}`;
}

/** What an address asks for. */
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
