// The token: stored for this tab, sent as a header, never in an address.

const KEY = "iplw-token";

/** The token, if there is one. */
export function token(): string | null {
  return sessionStorage.getItem(KEY);
}

/** Stores a token; an empty one is deleted. */
export function storeToken(value: string): void {
  if (value) sessionStorage.setItem(KEY, value);
  else sessionStorage.removeItem(KEY);
}
