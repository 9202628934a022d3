"""French questions and answers."""

import re

from socialbot.runs.asking.languages.language import Language, Voices, word_set

FRENCH = Language(
    "fr",
    {
        "why": (
            "pourquoi,comment ca se fait,comment se fait,d ou vient,pour quelle raison,quelle raison,raison,"
            "comment se fait il,qu est ce qui t a pousse,explique,"
            "a cause de quoi,dans quel but,comment as tu decide,comment savais tu,comment as tu su,sur quelle base,"
            "qu est ce qui t a fait,pour quel motif,motif"
        ),
        "what": (
            "que,quoi,qu est ce que,qu est ce qu,qu,quelque chose,decris,quelle,quel,comment as tu reagi,"
            "comment avez vous reagi"
        ),
        "who": "qui,quelles personnes,quels visiteurs,quelle personne,quel robot,quel agent,qui est ce que,de qui",
        "when": "quand,a quelle heure,a quel moment,depuis quand",
        "how_often": "combien de fois,a quelle frequence",
        "how_many": "combien de,combien,nombre de",
        "unanswerable": (
            "comment s appelle,comment s appelait,comment t appelles,ou,quel age,quelle couleur,comment,"
            "combien coute,a qui appartient,a qui appartiennent,appartient,"
            "a qui est"
        ),
        "not": "n as,n avez,n a,n ont,n ai,pas,jamais,aucun,aucune,oublie,omis,refuse,sans",
        "see": (
            "vois,voyez,voir,vu,vue,vues,vus,voyais,apercois,remarque,apercu,devant toi,devant vous,visible,observes,"
            "observe,camera,voyait,voyaient,voit,voient,voyiez,vit"
        ),
        "do": (
            "fais,faites,faire,fait,faisais,occupe,fabriques,reagi,fis,fit,firent,faisait,faisaient,font,faisiez,"
            "feras,fera,ferez"
        ),
        "happen": "passe,arrive,passait,produit",
        "next": "ensuite,apres,prochaine,prochain,suite,suivant",
        "plan": (
            "quelque chose a faire,reste a faire,reste il a faire,comptes,comptais,prevois,prevu,prevoyais,"
            "veux,voulais,vas,allais,allez,intention,but,objectif,plan,"
            "voulez,feras,projet,va faire,vont faire,compte,comptent,veut,veulent,prevoit,prevoient,prevoyez,comptez,"
            "ferez,fera"
        ),
        "outcome": (
            "fin,fini,finie,termine,terminee,reussi,reussie,succes,resultat,accompli,bien passe,bien passee,bien marche"
        ),
        "fail": (
            "probleme,problemes,echoue,echouer,echec,erreur,rate,mal passe,difficulte,mal tourne,accident,incident,"
            "panne,souci,soucis,pas marche,pas fonctionne,pas reussi,marche pas,fonctionne pas"
        ),
        "say": (
            "dis,dit,dire,dites,parle,dite,disais,phrase,mots,paroles,disait,disent,disiez,repondu,reponds,repondre,"
            "repondait,raconte,parlais,parlait,parles,parlez,mentionne,demande,demandes,demandais"
        ),
        "hear": "entendu,entends,entendais,entendre",
        "replies": "repondu,repondis,repondit,reponds,repond,repondre",
        "asks": "demande,demandes,demandais,demander,prie",
        "here": (
            "ici,la,venu,venue,venus,passe,present,presente,visite,arrive,parti,reste,restee,restes,rester,partie,"
            "partis,suis venu,suis arrive,suis parti,arrivee,arrives,arrivees,venues,parties,passee"
        ),
        "people": (
            "gens,personnes,personne,visiteur,visiteurs,visiteuse,homme,femme,quelqu un,invite,invites,humain,enfant"
        ),
        "group": "couple,paire",
        "nobody": "personne n,vide",
        "me": "me,m,moi,je,j,nous,mon",
        "you": "tu,te,t,vous,toi,robot",
        "them": "lui,elle,l,le,la,les,il,ils,eux",
        "past": "aies,ait,as,avez,a,ai,ont,etait,etaient,etais,ete,viens,deja,auparavant,est venu,est elle,est il",
        "future": "vas,allez,feras,ferez,prochaine,ensuite,va faire,vont faire,fera,feront",
        "present": "est,es,sont,peux,maintenant,actuellement,vois,fais,en train",
        "ago": "il y a",
        "first": "premier,premiere,d abord",
        "last": "dernier,derniere",
        "ordinals": "deuxieme,troisieme,quatrieme,cinquieme,sixieme,septieme,huitieme,neuvieme,dixieme",
        "time": "fois",
        "seconds": "s,sec,seconde,secondes",
        "minutes": "min,minute,minutes",
        "at": "a,apres,vers,au bout de,dans",
        "end": "a la fin,tout a la fin,vers la fin,finalement,enfin",
        "overall": "en tout,au total,jusqu ici",
        "talk": "parler,parle,discuter",
        "silent": "silencieux,muet,silence,tu t es tu,abstenu",
        "request": "peux tu,pourrais tu,pouvez vous,s il te plait",
        "start": "au debut,au commencement",
        "recently": "a l instant,juste,maintenant",
        "how_long": (
            "combien de temps,depuis combien de temps,pendant combien de temps,depuis combien,combien de secondes,"
            "combien de minutes,depuis quand,combien de temps as tu mis,combien de temps a t il fallu"
        ),
        "where": (
            "d ou,a quel endroit,dans quel endroit,ou as tu,ou avez vous,ou est,ou es,ou etait,ou etais,ou etaient,"
            "ou sont,ou se trouve,ou se trouvait"
        ),
        "how_far": "a quelle distance,quelle distance,de combien",
        "auxiliary": "as,avez,a,ont,es,est,etes,etait,etaient",
        "all": "tous,toutes,tout le monde,chacun,chaque",
        "shortest": "le moins longtemps,moins longtemps,plus court,plus courte",
        "longest": "le plus longtemps,plus longtemps",
        "but": "mais,et,tandis que,alors que",
        "rather": "plutot que,au lieu de,et pas,mais pas,et non",
        "event after": "apres que,des que,une fois que,apres,plus tard que",
        "event before": "avant que,avant de,avant d,avant,jusqu a ce que,et puis,et ensuite,plus tot que",
        "follows": "a suivi,suivit,suit,est venu apres,vint apres",
        "precedes": "a precede,precede,est venu avant",
        "event when": "quand,lorsque,lorsqu,pendant que,au moment ou",
        "comes": "venu,venue,venus,arrive,arrivee,arrives,entre,entree,apparu,apparue,vient,arrivait,arriva",
        "leaves": "parti,partie,partis,part,partait,sorti,sortie,disparu,disparue,quitte",
        "waits": "attendu,attendre,hesite,attends",
        "matrix": (
            "savoir,sais,savez,dire,dis,dites,rappelles,souviens,souvient,demande,demander,curieux,curieuse,interesse,"
            "comprends,sur,sure,idee,expliquer,aimerais,voudrais,veux,peux,pourrais,pouvez,pourriez,voulez,explique,"
            "entendre,apprendre,plairait,gentil,vrai"
        ),
        "or": "ou",
        "which": "quel,quelle,quels,quelles",
        "why not": "pourquoi pas",
        "complement": "si,vrai que,exact que,sur que",
        "times": (
            "deux fois,trois fois,plusieurs fois,une fois,une seule fois,plus d une fois,encore,de nouveau,a nouveau,"
            "encore une fois,chaque fois,toujours,une autre fois"
        ),
        "others": (
            "d autre,d autres,autre,autres,a part,sauf,excepte,hormis,en dehors de,seulement,uniquement,seul,seule,"
            "la plupart,tout sauf"
        ),
        "hypothetical": "et si,que ferais tu,que feriez vous,aurais tu,auriez vous,se passerait il,serait il passe",
        "qualified": (
            "parce que,ensemble,en meme temps,plus tot,plus tard,au lieu de,plutot que,trop tard,trop tot,"
            "a temps,presque,a peine,tout de suite,par erreur,afin de,une femme,un homme,un enfant,femmes,"
            "hommes,enfants,en francais,en anglais"
        ),
        "filler": (
            "a propos de,a propos d,au sujet de,au sujet d,excuse moi,excusez moi,pardon,recu,recois,obtenu,moment,"
            "euh,ben,aujourd hui,bah,alors,donc,hein,eh bien,au fait,est ce que,"
            "s il te plait,s il vous plait,bonjour,dis moi,dites moi,peux tu me dire,pouvez vous me dire,sais tu,le,"
            "la,les,l,un,une,des,de,du,d,a,au,aux,et,en,ce,c,cela,ca,que,qu,est ce,pour,mon,ma,votre,ton,ne,n,y,est,"
            "dans,sur,avec,son,sa,il,on,train,si,se,s,seconde,t,fois,total,quel,quelle,chose,choses,deja,vraiment,"
            "simplement,ensemble,elle,avait,besoin,qui,entre temps,equipe,robots,ta,tes,ses,mes,notre,"
            "nos,vos,leur,leurs,au milieu de ton travail,au milieu du travail,en plein travail,pendant le travail"
        ),
        "left out": "rien,mains vides,laisse de cote,laissee de cote,exclu,exclue,oublie,oubliee,neglige,negligee",
        "between": "entre",
        "called": "appele,appelee,nomme,nommee,du nom de,qui s appelle,qui s appelait",
        "step": "etape,etapes",
        "replan": (
            "nouveau plan,autre plan,replanifier,replanifie,plan different,change de plan,changer de plan,"
            "change ton plan,changer ton plan,deuxieme plan,second plan"
        ),
        "to": "a,au,aux,dans,vers,sur",
        "from": "de,du,des,d,depuis,quitte,quitter",
        "article": "le,la,les,l,un,une",
        "being": "est,etait,sont,etaient,fut,a ete,ont ete,y a t il,y avait il,il y avait,il y a,se trouvait",
        "at place": "dans,sur,sous,derriere,devant,a cote,a l interieur,entre,pres,au dessus,au dessous",
    },
    {
        "because": " car",
        "decimal": ",",
        "and": "et",
        "at": "à {at} s",
        "within": "de {at} à {until} s, {clause}",
        "ago": "il y a {ago} secondes",
        "just_now": "à l'instant",
        "then": "{when}, {clause}",
        "person": "la personne {id}",
        "somebody": "quelqu'un",
        "anybody": "qui que ce soit",
        "yes": "Oui",
        "no": "Non",
        "unknown": "Je ne sais pas",
        "unclear": "Je ne suis pas sûr de comprendre la question",
        "able": (
            "Je peux dire pourquoi j'ai fait quelque chose ou non, ce que j'ai vu, dit, fait et prévu, "
            "et qui était là et quand"
        ),
        "not_recorded": "l'enregistrement ne le dit pas",
        "belief": "je croyais {what}",
        "no_belief": "je ne croyais pas {what}",
        "saw_none": "je ne voyais personne",
        "saw_one": "je voyais {people}",
        "away": "{person} à {distance} m",
        "side": "{person} {side} de l'image",
        "sides": "à gauche|au milieu|à droite",
        "nobody_came": "il n'y avait personne",
        "here": "{person} était là de {at} à {until} s",
        "here_you": "vous étiez là de {at} à {until} s",
        "counted": "{count} personnes étaient là",
        "counted_one": "une personne était là",
        "times": "{count} fois",
        "people": "{count} personnes",
        "people_one": "une personne",
        "times_one": "une fois",
        "said": "j'ai dit « {what} »",
        "heard": "{person} a dit « {what} »",
        "heard_you": "vous avez dit « {what} »",
        "failed": "j'ai échoué : {what}{why}",
        "ended": "le plan pour {what} s'est terminé : {outcome}{why}",
        "nothing_failed": "rien n'a échoué",
        "took": "cela a duré {value} s",
        "said_nothing": "je n'ai rien dit",
        "not_named": "l'enregistrement ne mentionne pas « {word} »",
        "said_no_words": "je n'ai pas dit « {what} »",
        "nothing_next": "je n'avais aucune intention",
        "next_was": "la suite était {when} : {clause}",
        "last_was": "la dernière chose était {when} : {clause}",
        "nothing_done": "je ne faisais rien",
        "wanted": "je voulais {what}",
        "assumes": "Je vous prends pour la personne {id}.",
        "examples": "Que vois-tu ? | Qu'as-tu fait à {at} secondes ? | Qui était là ? | Que vas-tu faire ensuite ?",
    },
    Voices(
        you=word_set("tu vous"),
        to_you=word_set("te t toi vous"),
        passive=word_set("ete fus fut"),
        by=word_set("par"),
        receive=word_set("recu recois eu obtenu"),
        source=word_set("de par"),
        third=word_set("a ont avait avaient"),
        participle=re.compile(".*(?<!er)"),
        second=re.compile(".*[sxz]"),
        first=word_set("ai"),
    ),
    letters="àâçèêëîïôûùœ",
)
