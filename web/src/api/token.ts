// The token: kept for this tab until it is closed, sent as a header, never in an address.

const KEY = "iplw-token";

/** The token, if there is one. */
export function token(): string | null {
  return sessionStorage.getItem(KEY);
}

/** Keeps a token; an empty one is forgotten. */
export function storeToken(value: string): void {
  if (value) sessionStorage.setItem(KEY, value);
  else sessionStorage.removeItem(KEY);
}
