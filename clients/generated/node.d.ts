// The little of node that the episode needs, instead of all of its types.
declare const process: { argv: string[] };
