// Order of the results of a search: a page of the API comes after every other page.
var Scorer = {
  score: ([docname, , , , score]) => (docname.startsWith("reference/api/") ? score - 1000 : score),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
